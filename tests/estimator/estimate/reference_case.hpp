#pragma once

#include <fstream>
#include <memory>
#include <sstream>
#include <string>
#include <vector>

#include <nlohmann/json.hpp>

#include "estimator/estimate/estimate.hpp"
#include "models/catalogue/registry.hpp"
#include "tests/catch.hpp"
#include "tests/estimator/estimate/reference_model.hpp"
#include "tests/estimator/interface/flow_residual.hpp"
#include "tests/estimator/interface/function_residual.hpp"
#include "tests/estimator/interface/node_chain_residual.hpp"
#include "tests/source_folder.hpp"

namespace orbid::tests {

/// Numbers of a comma separated file below its header line, shape (lines, columns).
inline Eigen::MatrixXd reference_table(const std::string& path) {
    std::ifstream file(orbid::tests::source_folder() + "/tests/reference/" + path);
    std::string line;
    std::getline(file, line);
    std::vector<std::vector<double>> rows;
    while (std::getline(file, line)) {
        std::istringstream text(line);
        std::vector<double> row;
        for (std::string cell; std::getline(text, cell, ',');)
            row.push_back(std::stod(cell));
        rows.push_back(std::move(row));
    }
    REQUIRE_FALSE(rows.empty());
    Eigen::MatrixXd table(std::ssize(rows), std::ssize(rows.front()));
    for (std::size_t i = 0; i < rows.size(); ++i)
        table.row(static_cast<Eigen::Index>(i)) = Eigen::Map<const Eigen::RowVectorXd>(rows[i].data(), table.cols());
    return table;
}

inline nlohmann::json reference_json(const std::string& path) {
    std::ifstream file(orbid::tests::source_folder() + "/tests/reference/" + path);
    REQUIRE(file.good());
    return nlohmann::json::parse(file);
}

/// The first `count` parameters of a system are the first entries of a theta of length `length`.
inline models::ParameterBinding leading_parameters(const models::System& system, Eigen::Index count,
                                                   Eigen::Index length) {
    models::ParameterBinding binding;
    binding.base = system.default_parameters();
    binding.estimated_count = length;
    for (Eigen::Index i = 0; i < count; ++i) {
        binding.parameter.push_back(i);
        binding.estimated.push_back(i);
    }
    return binding;
}

inline std::vector<double> to_vector(const Eigen::VectorXd& values) {
    return {values.begin(), values.end()};
}

inline estimator::FreeParameter log_parameter(std::string name, double start, estimator::Prior prior = {}) {
    estimator::FreeParameter parameter;
    parameter.name = std::move(name);
    parameter.start = start;
    parameter.scale = estimator::Scale::log;
    parameter.lower = 0.0;
    parameter.prior = prior;
    return parameter;
}

/// Bock and Sager's readings with their known sds. One unknown factor on all of them belongs to one group; `factor`
/// fixed at 1 takes the sds as they are.
inline StateReadings bock_readings(bool estimate_factor) {
    const Eigen::MatrixXd table = reference_table("bock_lotka_volterra/data.csv");
    REQUIRE(table.cols() == 5);
    StateReadings data;
    data.times = to_vector(table.col(0));
    data.coordinates = {0, 1};
    data.values.resize(table.rows(), 2);
    data.values << table.col(1), table.col(3);
    data.deviation.resize(table.rows(), 2);
    data.deviation << table.col(2), table.col(4);
    estimator::Group readings = group("readings", 1.0, estimate_factor);
    readings.factor = true;
    data.groups = {readings};
    return data;
}

/// theta = (p1, p2, x(0), y(0)).
inline FlowResidual bock_single_shooting(bool estimate_factor) {
    const auto system = bock_system();
    StateReadings data = bock_readings(estimate_factor);
    return {system, leading_parameters(*system, 2, 4), {{0.0, 2}, {0.0, 3}}, std::move(data)};
}

/// theta = (p1, p2), the nodes are latent.
inline NodeChainResidual bock_multiple_shooting(bool estimate_factor) {
    const auto system = bock_system();
    return {system, leading_parameters(*system, 2, 2), bock_readings(estimate_factor)};
}

/// Hudson's Bay: theta = (alpha, beta, gamma, delta, hare(0), lynx(0)), log-normal errors.
inline FlowResidual hare_lynx_residual() {
    const auto system = models::make_system("lotka_volterra");
    const Eigen::MatrixXd table = reference_table("hare_lynx/hare_lynx.csv");
    StateReadings data;
    data.times = to_vector(table.col(0));
    data.coordinates = {0, 1};
    data.values = table.rightCols(2);
    for (const char* name : {"sigma_hare", "sigma_lynx"}) {
        estimator::Group readings = group(name, 0.25);
        readings.scale.prior = estimator::LogNormalPrior{std::exp(-1.0), 1.0};
        readings.distribution = estimator::LogNormalErrors{};
        data.groups.push_back(readings);
    }
    return {system, leading_parameters(*system, 4, 6), {{0.0, 4}, {0.0, 5}}, std::move(data)};
}

inline std::vector<estimator::FreeParameter> hare_lynx_parameters() {
    using estimator::LogNormalPrior;
    using estimator::NormalPrior;
    return {log_parameter("alpha", 0.55, NormalPrior{1.0, 0.5}),
            log_parameter("beta", 0.03, NormalPrior{0.05, 0.05}),
            log_parameter("gamma", 0.8, NormalPrior{1.0, 0.5}),
            log_parameter("delta", 0.025, NormalPrior{0.05, 0.05}),
            log_parameter("hare_0", 30.0, LogNormalPrior{10.0, 1.0}),
            log_parameter("lynx_0", 4.0, LogNormalPrior{10.0, 1.0})};
}

/// One compartment: theta = (k_a, K_m, V_m), log-normal errors.
inline FlowResidual michaelis_menten_residual() {
    const auto system = michaelis_menten_system();
    const Eigen::MatrixXd table = reference_table("michaelis_menten/concentration.csv");
    StateReadings data;
    data.times = {0.0};  // where the dose is given; nothing is read there
    for (const double t : table.col(0))
        data.times.push_back(t);
    data.coordinates = {1};
    data.values = table.col(1);
    estimator::Group readings = group("sigma", 0.13);
    readings.scale.prior = estimator::HalfCauchyPrior{1.0};
    readings.distribution = estimator::LogNormalErrors{};
    data.groups = {readings};
    constexpr double dose = 30.0;
    constexpr double volume = 2.0;
    return {system, leading_parameters(*system, 3, 3), {{dose / volume, -1}, {0.0, -1}}, std::move(data)};
}

inline std::vector<estimator::FreeParameter> michaelis_menten_parameters() {
    const estimator::HalfCauchyPrior prior{1.0};
    return {log_parameter("k_a", 0.75, prior), log_parameter("K_m", 1.0, prior), log_parameter("V_m", 0.9, prior)};
}

}  // namespace orbid::tests
