#pragma once

#include <algorithm>
#include <cstddef>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include <Eigen/Core>

#include "estimator/interface/eigen_layout.hpp"
#include "identification/problem/record_errors.hpp"
#include "orbits/cycles/cycle_waveform.hpp"
#include "periodic/orbit/shooting_mesh.hpp"
#include "periodic/waveforms/orbit_measures.hpp"
#include "periodic/waveforms/waveform_record.hpp"

#pragma GCC visibility push(default)

namespace orbid::identification {

/// How closely the end of an interval of a series must agree with the beginning of the next.
struct Matching {
    enum class Kind {
        automatic,  ///< exact for a simulated record, and for one that the model then explains; else estimated
        exact,      ///< to far below the errors of the readings
        given,      ///< normal errors of a known sd
        estimated,  ///< normal errors, their sd estimated
        diffusion   ///< errors of a process noise that is estimated, see orbits::Continuity::Kind::diffusion
    };
    Kind kind = Kind::automatic;
    double sd = 0.0;  ///< given: share of each coordinate's range, > 0
};

/// Recorded series, by single or multiple shooting.
struct SeriesChoice {
    static constexpr std::size_t automatic_interval = 0;  ///< chosen by how errors grow
    /// Sampling intervals (sections) from node to node. Nothing: one free initial state per segment (single shooting).
    std::optional<std::size_t> interval;
    /// Without an interval: `automatic_interval` where errors of the first state grow too much along a segment
    /// (identification/starts/whole_segments.hpp).
    bool unless_errors_grow = false;
    Matching matching;                 ///< ignored without an interval
    std::vector<std::size_t> data;     ///< indices of experiments
    std::vector<RecordErrors> errors;  ///< one per coordinate observed in any of them, ascending
    std::vector<JointErrors> covariances;
};

/// Measured periodic steady states, one per fitted segment.
struct WaveformChoice {
    struct Experiment {
        int period = 1;     ///< in periods of the forcing
        double time = 0.0;  ///< autonomous: a guess of T [s]; 0: told from the record
        periodic::WaveformUnknown phase{true, 0.0};
        std::vector<periodic::WaveformUnknown> offsets;  ///< one per entry of `errors`
        Eigen::MatrixXd start;                           ///< shape (n, period): states at phase 0; empty: found
    };
    std::vector<std::size_t> data;        ///< indices of experiments
    std::vector<Experiment> experiments;  ///< one per entry of `data`
    std::vector<RecordErrors> errors;     ///< one per coordinate observed in any of them, ascending
    std::vector<JointErrors> covariances;
    /// The records are not those of the segments, but the waveforms of cycles found in the record of the only
    /// experiment in `data`; their rows are those of `errors`, whose scales are factors on the sds of the waveforms.
    bool of_cycles = false;
    std::vector<orbits::CycleWaveform> cycles = {};
};

/// Amplitudes and frequencies of periodic motions, stable or unstable, that were measured over a parameter.
struct BranchChoice {
    struct Channel {
        periodic::OrbitMeasure measure = periodic::OrbitMeasure::half_range;
        RecordErrors errors;  ///< and the coordinate, or n + i of `readings`; without meaning for the frequency
    };
    Eigen::Index parameter = 0;  ///< of the model, which varies along the branch; it is not estimated
    std::vector<Channel> channels;
    Eigen::VectorXd at;          ///< shape (m): its values
    double at_sd = 0.0;          ///< of their errors; 0: they are exact
    Eigen::MatrixXd values;      ///< shape (channels, m); nan = not measured
    Eigen::MatrixXd deviations;  ///< known sds, likewise; empty: none
    /// An orbit of the branch at the problem's own values of all parameters, near enough for Newton's method.
    periodic::StartingSolution start;
    /// Over which the branch is followed; nothing: half as far again as the values reach.
    std::optional<std::pair<double, double>> range;
    std::vector<periodic::OrbitReading> readings{};  ///< formulas that were measured beside coordinates
};

enum class ResidualType { cycles, series, waveform, branch };

/// One stage of a strategy; it starts from the best earlier one.
struct Stage {
    enum class Kind {
        prediction,  ///< parameters only, by predictions over one interval from measured states
        residuals,   ///< the residuals named, together
        harvest      ///< adds cycles found with the present model, then as the stage of the cycles
    };
    Kind kind = Kind::residuals;
    std::vector<ResidualType> residuals;  ///< in their order; empty for `prediction`
    /// Left out where the series before it is explained (stages/series_doubt.hpp). Where it is not, the first such
    /// stage begins where the series began.
    bool if_needed = false;

    [[nodiscard]] bool uses(ResidualType type) const {
        return std::find(residuals.begin(), residuals.end(), type) != residuals.end();
    }
    /// Series alone.
    [[nodiscard]] bool is_series() const {
        return kind == Kind::residuals && residuals.size() == 1 && uses(ResidualType::series);
    }
    /// "prediction", "harvest", "series", "cycles + series".
    [[nodiscard]] std::string name() const;
};

}  // namespace orbid::identification

#pragma GCC visibility pop
