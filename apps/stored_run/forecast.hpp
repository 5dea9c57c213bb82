#pragma once

#include <cmath>
#include <cstddef>
#include <functional>
#include <limits>
#include <string>
#include <vector>

#include <Eigen/Core>

#include "apps/results/result_file.hpp"
#include "apps/stages/data_stage.hpp"
#include "apps/stored_run/prediction_job.hpp"

namespace orbid::apps {

/// Errors of predictions of one coordinate.
struct CoordinateForecast {
    std::string name;
    std::string unit;
    double rms = std::numeric_limits<double>::quiet_NaN();  ///< in its unit
    double sd = std::numeric_limits<double>::quiet_NaN();   ///< rms sd of the readings' errors
};

/// How well one segment of a sampled record is predicted.
struct SegmentForecast {
    static constexpr double unknown = std::numeric_limits<double>::quiet_NaN();

    std::string segment;
    std::string message;                     ///< why there is no prediction; empty otherwise
    std::size_t readings = 0;                ///< of the whole segment
    double duration = 0.0;                   ///< of the segment, in the unit of its times
    std::vector<CoordinateForecast> course;  ///< with the initial state fitted to the whole segment
    double course_normalised = unknown;      ///< rms of errors over their sd

    double beginning = 0.0;                 ///< length of the stretch to which the forecast's initial state is fitted
    std::vector<CoordinateForecast> ahead;  ///< errors after that stretch
    double ahead_normalised = unknown;
    double horizon = unknown;   ///< how long after the stretch errors stay within 2 sds (rms over ten samples)
    bool whole = false;         ///< to the end of the segment
    double growth = unknown;    ///< rate at which a small change of the initial state grows: 1 / Lyapunov time
    double coverage = unknown;  ///< share of the readings ahead within the 95 % band, while the band is meaningful
    std::size_t covered = 0;    ///< number of readings for `coverage`
};

/// How well sections are predicted one step ahead.
struct StepForecast {
    std::size_t steps = 0;
    std::size_t failed = 0;
    std::vector<CoordinateForecast> coordinates;
    std::vector<double> expected;  ///< rms due to errors of the readings, amplified by the step; nan: unknown
    double normalised = std::numeric_limits<double>::quiet_NaN();  ///< rms of errors over the expected rms
    double growth = std::numeric_limits<double>::quiet_NaN();      ///< mean ln of the largest singular value of a step
};

struct Forecast {
    bool samples = true;
    bool known_errors = true;  ///< false: sds of readings are the residual rms of the fits to the beginnings
    std::vector<SegmentForecast> segments;  ///< of samples
    StepForecast steps;                     ///< of sections
    std::vector<ResidualRow> rows;          ///< of the forecast: sd includes the errors of initial state and parameters
};

/// Predicts every segment of a sampled record twice: with the initial state fitted to all of it (as for segments in
/// "predict" of a job), and fitted to its beginning, at most a tenth. That stretch doubles from 20 samples on while the
/// fit stays within twice the errors of the readings.
///
/// The band around the forecast is that of readings, initial state and parameters to first order:
///
///     var_k = sd_k^2 + J_z C_z J_z' + J_theta C_theta J_theta',   C_z = (sum J_z' J_z / sd^2)^-1 over the stretch.
///
/// Sections are predicted one step ahead from every reading: the measured state, with its errors amplified by the step,
/// sqrt(sd_i^2 + sum_j (X_ij sd_j)^2).
/// @param progress  called with the number of segments done; may be empty.
/// @throws orbits::DataError when the record does not suit the model.
[[nodiscard]] Forecast forecast(const PredictionJob& job, const Experiment& record,
                                const std::function<void(std::size_t done)>& progress = {});

namespace detail {

/// Root of the mean of `count` squares, from their sum; nan without any.
[[nodiscard]] inline double root_mean_square(double squares, std::size_t count) {
    return count > 0 ? std::sqrt(squares / static_cast<double>(count)) : std::numeric_limits<double>::quiet_NaN();
}

/// The part of forecast() for sections: fills in `steps`, `rows` and `known_errors`.
void forecast_sections(const PredictionJob& job, const Experiment& record, Forecast& out);

}  // namespace detail

}  // namespace orbid::apps
