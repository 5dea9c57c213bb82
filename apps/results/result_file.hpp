#pragma once

#include <functional>
#include <map>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "apps/documents/fingerprint.hpp"
#include "apps/results/posterior_results.hpp"
#include "apps/results/strategy_results.hpp"
#include "estimator/estimate/estimate.hpp"
#include "identification/problem/structural_report.hpp"
#include "periodic/orbit/orbit.hpp"

namespace orbid::apps {

/// An estimated initial state of one segment, coordinate by coordinate.
struct InitialState {
    std::string experiment;
    std::string segment;
    struct Value {
        std::string coordinate;
        std::string unit;
        double value = 0.0;
        double sd = 0.0;         ///< nan when undetermined or held fixed
        bool estimated = false;  ///< false: held at a given value
    };
    std::vector<Value> values;
};

/// A measured periodic steady state at the estimate: its record compared with the computed solution.
struct SteadyState {
    std::string experiment;
    std::string segment;
    bool used = true;  ///< false: lost
    InitialState::Value phase;
    std::vector<InitialState::Value> offsets;
    periodic::PeriodicOrbit orbit;
};

/// Prediction of a segment that was not in the fit (or was: see `fitted`).
struct Prediction {
    std::string experiment;
    std::string segment;
    std::vector<std::pair<std::string, double>> rms;  ///< per coordinate, in its unit
    double normalised_rms = 0.0;                      ///< rms over the error sd; nan when there is none
    bool fitted = false;
    std::vector<std::size_t> readings{};  ///< per coordinate of `rms`
};

/// A simulated trajectory that ceased to be chaotic.
struct Capture {
    std::string experiment;
    int trajectory = 0;
    std::size_t section = 0;  ///< points after which it was noticed
    std::string what;         ///< "at rest", "captured by a stable orbit of period 10"
};

/// The contents of result.json beside the estimate.
struct ResultContext {
    std::string evaluated;  ///< equations of the job: "compiled" or "interpreted"; empty: a model of the registry
    std::map<std::string, double> reference;  ///< known values, by name of a parameter or derived quantity
    std::vector<InitialState> initial_states;
    std::vector<SteadyState> steady_states;
    std::vector<Prediction> predictions;
    std::map<int, std::size_t> orbits_found;  ///< period -> cycles
    std::vector<int> orbits_missing;
    bool cycles_share_errors = false;  ///< the estimate uses cycles whose common errors are not known
    /// What makes the model jump, if the estimate uses cycles of one smooth map and no series; else empty.
    std::string blurred_jumps;
    std::size_t data_points = 0;
    std::size_t data_segments = 0;
    std::vector<Capture> captured;
    PosteriorResults posterior;
    LogEvidence evidence;
    StrategyResults strategy;
    identification::StructuralReport structure;
    /// See unexplained_spread(); of the records that the estimate uses.
    std::vector<std::pair<std::string, double>> unexplained;
    bool whole_segments = false;  ///< a series is followed over whole segments
    Fingerprint fingerprint;      ///< left out of the file when its hash is empty
};

/// (value - reference) / reference; nan without a reference or with reference 0.
[[nodiscard]] double relative_deviation(double value, const std::optional<double>& reference);

/// Names with the components of a null direction, by descending size; what is smaller than 1e-6 of the largest is
/// rounding of the singular value decomposition (1e-16 / relative_singular_value 1e-9, times ten) and left out.
[[nodiscard]] std::vector<std::pair<std::string, double>> named_components(
    const estimator::NullDirection& direction, const std::vector<estimator::Estimated>& parameters);

/// Content of result.json, format orbid-result/1. Undefined numbers are null.
///
/// Beside the keys of the contract: `model` with `evaluated`, where the job writes its equations; per parameter
/// `laplace_sd`, `data_share`, `bias` (what was taken off), `hessian_ratio`, and `held`, the reason, where no record
/// determines it; per error scale `distribution` and its parameters, `rms`, `lag1`, `correlation_records`,
/// `effective_count`, `estimated`; `covariance`, `covariances`, `log_evidence`, `stages`, `matching`, `criticism`,
/// `diagnostics`, `posterior`, `verdict` (see trust_verdict()), `profile`, `marginals`, `optima`, `rounds`, `history`,
/// `steady_states` (of waveforms). An interval is null as a whole when one of its ends is undefined.
[[nodiscard]] std::string result_text(const estimator::Estimate& estimate, const ResultContext& context);

/// A cell of a table in text: quoted when it holds a comma, a quote or a line end (RFC 4180).
[[nodiscard]] std::string csv_cell(const std::string& text);

/// One line of residuals.csv. `sd`: of the error of this record; of Student's t and Laplace errors the scale.
struct ResidualRow {
    std::string experiment;
    std::string block;  ///< segment or cycle
    std::string coordinate;
    double at;  ///< time [s] or phase [rad]
    double observed;
    double predicted;
    double sd;
};

/// Content of residuals.csv: a header, one line per record; undefined numbers are empty cells, numbers read back to the
/// bit, cells with commas or quotes are quoted (RFC 4180).
/// @param interrupted  asked all along. @throws models::Stopped if it says so
[[nodiscard]] std::string residuals_text(const std::vector<ResidualRow>& rows,
                                         const std::function<bool()>& interrupted = {});

}  // namespace orbid::apps
