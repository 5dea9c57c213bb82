#pragma once

#include <cstddef>
#include <functional>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "apps/documents/json_reader.hpp"
#include "apps/job/job.hpp"
#include "estimator/interface/prior.hpp"
#include "estimator/interface/residual.hpp"
#include "identification/problem/identification_problem.hpp"
#include "orbits/records/series.hpp"

namespace orbid::apps {

/// The blocks of a job, each read into its part of `job`. Order: model, data, orbits, periodic, estimate, reference;
/// each block uses the earlier ones. Where the model is unknown, names and domains are not checked.
void read_model(ObjectReader& root, Job& job);
void read_section(ObjectReader& root, Job& job);
/// The names in the formulas of the sensors in "data", and those of delays, before the model is known that they are
/// parsed with.
[[nodiscard]] std::vector<std::string> names_in_data(const JsonValue& data);
/// Those in the "readings" of the residuals of "estimate", likewise.
[[nodiscard]] std::vector<std::string> names_in_residuals(const JsonValue& estimate);
void read_data(ObjectReader& root, Job& job);
void read_orbits(ObjectReader& root, Job& job);
void read_periodic(ObjectReader& root, Job& job);
void read_estimate(ObjectReader& root, Job& job);

/// Whether any of these experiments (indices into Job::data) reads an angle for the coordinate; without experiments,
/// whether the coordinate is an angle.
[[nodiscard]] bool reads_angle(const Job& job, const std::vector<std::size_t>& data, Eigen::Index coordinate);

/// Indices of the experiments of this sampling.
[[nodiscard]] std::vector<std::size_t> experiments_with(const Job& job, orbits::Series::Sampling sampling);
/// Indices of named experiments, ascending.
/// @param check  called with each, and the place of its name.
[[nodiscard]] std::vector<std::size_t> read_experiments(
    const ValueReader& value, const Job& job,
    const std::function<void(const ValueReader& item, const DataJob& data)>& check = {});

/// Names of a model's parameters, coordinates or inputs.
template <class Entry>
[[nodiscard]] std::vector<std::string> names_of(std::span<const Entry> entries) {
    std::vector<std::string> names;
    for (const Entry& entry : entries)
        names.emplace_back(entry.name);
    return names;
}

/// Names of the model's parameters or coordinates; empty without a model.
[[nodiscard]] std::vector<std::string> parameter_names(const Job& job);
[[nodiscard]] std::vector<std::string> coordinate_names(const Job& job);

/// Index of a parameter or coordinate; an unknown name is reported at `at` with the nearest known one.
[[nodiscard]] std::optional<Eigen::Index> parameter_named(const std::string& name, const ValueReader& at,
                                                          const Job& job);
[[nodiscard]] std::optional<Eigen::Index> coordinate_named(const std::string& name, const ValueReader& at,
                                                           const Job& job);
/// A list of names, each with its place.
[[nodiscard]] std::vector<std::pair<std::string, ValueReader>> read_names(const ValueReader& value);

/// A value of a parameter, checked against its domain.
[[nodiscard]] std::optional<double> read_parameter_value(const ValueReader& value, Eigen::Index parameter,
                                                         const Job& job);
/// "parameter": number, ...
[[nodiscard]] std::vector<ParameterValue> read_parameter_values(const ValueReader& value, const Job& job);

/// A list of different periods, each in [1, 64].
[[nodiscard]] std::optional<std::vector<int>> read_periods(const ValueReader& value);

/// A list of numbers; 0 where one is refused.
[[nodiscard]] Eigen::VectorXd read_numbers(const ValueReader& value);

/// A state of the model: one number per coordinate.
[[nodiscard]] std::optional<Eigen::VectorXd> read_state(const ValueReader& value, const Job& job);
/// Those of a list that are states.
[[nodiscard]] std::vector<Eigen::VectorXd> read_states(const ValueReader& value, const Job& job);

/// A square matrix of `size` rows [[...], ...].
[[nodiscard]] std::optional<Eigen::MatrixXd> read_matrix(const ValueReader& value, Eigen::Index size);

/// Names given by the user: [A-Za-z_][A-Za-z0-9_]*; reported otherwise.
[[nodiscard]] bool is_name(const std::string& name, const ValueReader& at);

/// An existing file, made absolute; a missing one is reported as unreadable data.
[[nodiscard]] std::optional<std::filesystem::path> read_path(const ValueReader& value, const Job& job);

}  // namespace orbid::apps
