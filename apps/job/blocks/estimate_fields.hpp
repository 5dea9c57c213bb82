#pragma once

#include <optional>
#include <string>
#include <vector>

#include "apps/job/blocks/field_kinds.hpp"
#include "apps/job/blocks/job_schema.hpp"
#include "apps/job/estimate_job.hpp"

namespace orbid::apps::describe {

// Fields of "estimate", by the files that state them.

/// "parameters".
[[nodiscard]] Field<EstimateJob> parameters_field();
/// "joint_priors", read after the parameters.
[[nodiscard]] Field<EstimateJob> joint_priors_field();
/// "residuals". They are all used at once where no strategy follows.
[[nodiscard]] Field<EstimateJob> residuals_field();
/// What "auto" uses when no residuals are named: cycles if searched or given, and the data as series. Their problems
/// are reported at `at`.
void add_usual_residuals(const ValueReader& at, const Job& job, EstimateJob& estimate);
/// Where the period of an autonomous model's waveforms is told from their records, and nothing else is estimated from:
/// a series with nodes of the same readings, as a stage before. It leaves parameters and states near the motion.
void add_waveform_start(const Job& job, EstimateJob& estimate);
/// "strategy" and "scan", read after the residuals.
void add_strategy_fields(FieldTable<EstimateJob>& table);
/// "multi_start", "posterior", "intervals", "profile" and "marginals", read after the parameters and residuals.
void add_posterior_fields(FieldTable<EstimateJob>& table);
/// "criticism", read after the parameters.
[[nodiscard]] Field<EstimateJob> criticism_field();

// Residuals: their keys; the usual data, before these are read; what concerns several keys, and errors, after that.
// `staged`: the strategy chooses what is not given.

[[nodiscard]] const FieldTable<SeriesResidualJob>& series_fields();
void prepare_series(ObjectReader& object, const Job& job, SeriesResidualJob& series);
void complete_series(ObjectReader& object, const Job& job, bool staged, SeriesResidualJob& series);
[[nodiscard]] const FieldTable<WaveformResidualJob>& waveform_fields();
void prepare_waveform(ObjectReader& object, const Job& job, WaveformResidualJob& waveform);
void complete_waveform(ObjectReader& object, const Job& job, bool staged, WaveformResidualJob& waveform);

[[nodiscard]] const FieldTable<BranchResidualJob>& measured_branch_fields();
void prepare_branch(ObjectReader& object, const Job& job, BranchResidualJob& branch);
void complete_branch(ObjectReader& object, const Job& job, bool staged, BranchResidualJob& branch);

/// Of one parameter.
[[nodiscard]] ValueSchema prior();
[[nodiscard]] std::optional<estimator::Prior> read_prior(const ValueReader& value);
[[nodiscard]] nlohmann::ordered_json prior_document(const estimator::Prior& prior);

/// What the records allow for their errors.
struct ErrorUse {
    enum class Records { cycles, cycles_with_covariance, series };
    Records records = Records::series;
    std::vector<Eigen::Index> coordinates;         ///< with errors
    std::vector<std::size_t> data;                 ///< series: indices into Job::data
    estimator::ErrorScale* multipliers = nullptr;  ///< for those of "ln_multiplier"; none: not data
    estimator::ErrorScale* times = nullptr;        ///< for those of "time"; none: not data

    /// Adds those that are not there; they are kept in order.
    void add_coordinates(const std::vector<Eigen::Index>& more);
};

/// "errors" and "covariance" of a residual: one entry per coordinate of `use`; the others are normal with an estimated
/// sd.
void read_errors(ObjectReader& residual, const ErrorUse& use, const Job& job, std::vector<ErrorJob>& errors,
                 std::vector<CovarianceJob>& covariances);

/// One entry of "errors".
[[nodiscard]] ErrorJob read_error(const ValueReader& value, const Job& job);
[[nodiscard]] nlohmann::ordered_json error_document(const ErrorJob& error, const Writing& at);
[[nodiscard]] const FieldTable<CovarianceJob>& covariance_fields();
[[nodiscard]] KeySchema errors_key();
[[nodiscard]] KeySchema covariance_key();
/// @param multipliers  errors of ln|multiplier|; nullptr where these are no data.
/// @param times        the same of T.
[[nodiscard]] nlohmann::ordered_json errors_document(const std::vector<ErrorJob>& errors,
                                                     const estimator::ErrorScale* multipliers,
                                                     const estimator::ErrorScale* times, const Writing& at);
/// A job has one covariance per residual.
[[nodiscard]] nlohmann::ordered_json covariance_document(const std::vector<CovarianceJob>& covariances,
                                                         const Writing& at);

/// The same two keys in the table of a residual; read_errors() reads them when all others are.
template <class Residual>
void add_error_fields(FieldTable<Residual>& table) {
    table.push_back({errors_key(), read_later<Residual>, [](const Residual& residual, const Writing& at) {
                         const estimator::ErrorScale* multipliers = nullptr;
                         const estimator::ErrorScale* times = nullptr;
                         if constexpr (requires { residual.multiplier_error; })
                             if (residual.multipliers) multipliers = &residual.multiplier_error;
                         if constexpr (requires { residual.time_error; })
                             if (residual.times) times = &residual.time_error;
                         return errors_document(residual.errors, multipliers, times, at);
                     }});
    table.push_back({covariance_key(), read_later<Residual>, [](const Residual& residual, const Writing& at) {
                         return covariance_document(residual.covariances, at);
                     }});
}

/// Experiments by name.
[[nodiscard]] nlohmann::ordered_json experiments_document(const std::vector<std::size_t>& data, const Writing& at);

/// "data" of a residual.
template <class Residual>
[[nodiscard]] Field<Residual> experiments_field() {
    return {
        key("data", names(1), "Experiments that belong to it; unless given those with samples, else with sections."),
        [](const ValueReader& value, const Job& job, Residual& residual) {
            residual.data = read_experiments(value, job);
        },
        [](const Residual& residual, const Writing& at) { return experiments_document(residual.data, at); }};
}

/// Names of the model's estimated parameters in the result: k2, or k2@run1 where one is free per experiment.
[[nodiscard]] std::vector<std::string> estimated_parameter_names(const Job& job,
                                                                 const std::vector<FreeParameterJob>& parameters);

}  // namespace orbid::apps::describe
