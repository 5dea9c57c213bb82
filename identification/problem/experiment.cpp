#include "identification/problem/experiment.hpp"

#include <algorithm>

#include <fmt/format.h>

#include "orbits/records/data_error.hpp"

namespace orbid::identification {

namespace {

/// A density of positive numbers alone.
bool is_positive(const estimator::Prior& prior) {
    return std::holds_alternative<estimator::LogNormalPrior>(prior) ||
           std::holds_alternative<estimator::GammaPrior>(prior) ||
           std::holds_alternative<estimator::HalfNormalPrior>(prior) ||
           std::holds_alternative<estimator::HalfCauchyPrior>(prior);
}

}  // namespace

void set_default_scale(InitialValue& value) {
    if (!is_positive(value.prior)) return;
    value.scale = estimator::Scale::log;
    value.lower = 0.0;
}

bool Experiment::has_own(Eigen::Index parameter) const {
    return std::find(free.begin(), free.end(), parameter) != free.end();
}

Eigen::VectorXd Experiment::with_own(Eigen::VectorXd values) const {
    for (const ParameterValue& own : parameters)
        values[own.parameter] = own.value;
    return values;
}

std::vector<std::size_t> Experiment::segments_with(const std::vector<std::string>& labels) const {
    std::vector<std::size_t> found;
    for (const std::string& label : labels) {
        const auto segment = std::find_if(series->segments.begin(), series->segments.end(),
                                          [&](const orbits::Segment& one) { return one.label == label; });
        if (segment == series->segments.end())
            throw orbits::DataError(fmt::format("{}: there is no segment \"{}\"", name, label));
        found.push_back(static_cast<std::size_t>(segment - series->segments.begin()));
    }
    return found;
}

std::vector<std::size_t> Experiment::fitted_segments() const {
    if (fit) return segments_with(*fit);
    const auto predicted = segments_with(predict);
    std::vector<std::size_t> rest;
    for (std::size_t s = 0; s < series->segments.size(); ++s)
        if (std::find(predicted.begin(), predicted.end(), s) == predicted.end()) rest.push_back(s);
    return rest;
}

}  // namespace orbid::identification
