#include "bench/measured_orbits.hpp"

#include <cmath>
#include <fstream>
#include <limits>
#include <numbers>
#include <stdexcept>

#include <nlohmann/json.hpp>

#include "models/catalogue/registry.hpp"

namespace orbid::bench {

using Eigen::Index;

namespace {

nlohmann::json read(const std::string& file) {
    std::ifstream stream(file);
    if (!stream) throw std::runtime_error("cannot read " + file);
    return nlohmann::json::parse(stream, nullptr, true, true);
}

Eigen::MatrixXd matrix(const nlohmann::json& rows) {
    Eigen::MatrixXd result(static_cast<Index>(rows.size()), static_cast<Index>(rows.at(0).size()));
    for (Index i = 0; i < result.rows(); ++i)
        for (Index j = 0; j < result.cols(); ++j) {
            const nlohmann::json& number = rows[static_cast<std::size_t>(i)][static_cast<std::size_t>(j)];
            result(i, j) = number.is_null() ? std::numeric_limits<double>::infinity() : number.get<double>();
        }
    return result;
}

orbits::Cycle cycle_of(const nlohmann::json& entry) {
    orbits::Cycle cycle;
    cycle.period = entry.at("period");
    cycle.points = matrix(entry.at("points")).transpose();
    cycle.covariance = matrix(entry.at("covariance"));
    cycle.ln_multiplier_covariance = matrix(entry.at("ln_multiplier_covariance"));
    cycle.recurrences = entry.at("recurrences");
    if (!entry.at("mirror").is_null()) cycle.mirror = entry["mirror"].get<std::size_t>();
    cycle.ln_multiplier.resize(cycle.ln_multiplier_covariance.rows());
    for (Index m = 0; m < cycle.ln_multiplier.size(); ++m) {
        const auto slot = static_cast<std::size_t>(m);
        const nlohmann::json& number = entry.at("ln_multiplier").at(slot);
        cycle.ln_multiplier(m) = number.is_null() ? -std::numeric_limits<double>::infinity() : number.get<double>();
        cycle.multipliers.emplace_back(entry.at("multipliers")[slot][0].get<double>(),
                                       entry["multipliers"][slot][1].get<double>());
    }
    return cycle;
}

}  // namespace

Eigen::VectorXd MeasuredOrbits::truth() const {
    Eigen::VectorXd theta(binding.estimated_count);
    for (std::size_t i = 0; i < binding.parameter.size(); ++i)
        theta(binding.estimated[i]) = binding.base(binding.parameter[i]);
    return theta;
}

std::vector<orbits::Cycle> MeasuredOrbits::noisy(double error, double multiplier_error, std::uint64_t seed) const {
    Numbers numbers(seed);
    std::vector<orbits::Cycle> result = exact;
    for (orbits::Cycle& cycle : result) {
        const Index records = cycle.points.size();
        cycle.covariance.setZero(records, records);
        for (Index k = 0; k < records; ++k) {
            const double sd = error * range(k % range.size());
            cycle.points(k % range.size(), k / range.size()) += sd * numbers.normal();
            cycle.covariance(k, k) = sd * sd;
        }
        for (Index m = 0; m < cycle.ln_multiplier.size(); ++m)
            cycle.ln_multiplier(m) += multiplier_error * numbers.normal();
        cycle.ln_multiplier_covariance =
            multiplier_error * multiplier_error *
            Eigen::MatrixXd::Identity(cycle.ln_multiplier.size(), cycle.ln_multiplier.size());
    }
    return result;
}

MeasuredOrbits measured_orbits(const std::string& job, const std::string& cycles,
                               const std::vector<std::string>& free) {
    MeasuredOrbits result;
    const nlohmann::json model = read(job).at("model");
    result.system = models::make_system(model.at("name").get<std::string>());
    const models::System& system = *result.system;
    result.binding = {system.default_parameters(), {}, {}, static_cast<Index>(free.size())};
    for (const auto& [name, value] : model.at("parameters").items())
        result.binding.base(system.parameter_index(name)) = value;
    for (const std::string& name : free) {
        const Index index = system.parameter_index(name);
        if (index < 0) throw std::runtime_error("there is no parameter " + name);
        estimator::FreeParameter parameter;
        parameter.name = name;
        parameter.start = result.binding.base(index);
        parameter.lower = 0.0;
        parameter.scale = estimator::Scale::log;
        parameter.typical_size = system.parameters()[static_cast<std::size_t>(index)].typical_size;
        result.binding.parameter.push_back(index);
        result.binding.estimated.push_back(static_cast<Index>(result.parameters.size()));
        result.parameters.push_back(parameter);
    }
    const nlohmann::json list = read(cycles);
    for (const nlohmann::json& entry : list.at("cycles"))
        result.cycles.push_back(cycle_of(entry));
    result.range = orbits::target_scale(system.coordinates(), result.cycles);
    orbits::CycleResidualOptions options;
    options.targets.weights = orbits::CycleWeights::equal;
    options.targets.multipliers = true;  // states of rest too
    const orbits::CycleResidual residual(result.system, result.binding, result.cycles, 0.0, result.truth(), {},
                                         options);
    const auto solved = residual.orbits(residual.initial_set(), result.truth());
    for (std::size_t b = 0; b < solved.size(); ++b) {
        if (solved[b].status != periodic::OrbitStatus::converged) continue;
        orbits::Cycle cycle;
        cycle.period = solved[b].period;
        cycle.rotation = solved[b].rotation;
        cycle.points = solved[b].points;
        cycle.multipliers = solved[b].multipliers;
        cycle.recurrences = result.cycles[residual.cycle_of(b)].recurrences;
        cycle.ln_multiplier.resize(static_cast<Index>(cycle.multipliers.size()));
        for (std::size_t m = 0; m < cycle.multipliers.size(); ++m)
            cycle.ln_multiplier(static_cast<Index>(m)) = std::log(std::abs(cycle.multipliers[m]));
        result.exact.push_back(std::move(cycle));
    }
    return result;
}

double Numbers::uniform() {
    state_ += 0x9e3779b97f4a7c15ULL;  // splitmix64
    std::uint64_t z = state_;
    z = (z ^ (z >> 30U)) * 0xbf58476d1ce4e5b9ULL;
    z = (z ^ (z >> 27U)) * 0x94d049bb133111ebULL;
    return (static_cast<double>((z ^ (z >> 31U)) >> 11U) + 0.5) * 0x1p-53;
}

double Numbers::normal() {
    const double radius = std::sqrt(-2.0 * std::log(uniform()));
    return radius * std::cos(2.0 * std::numbers::pi * uniform());
}

}  // namespace orbid::bench
