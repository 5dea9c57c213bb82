#include "apps/estimation/step_outlook.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include <fmt/format.h>

namespace orbid::apps {

namespace {

constexpr std::size_t steps_needed = 4;
// Slower than this the number of steps to come is a guess: the factor itself still changes.
constexpr double slowest_factor = 0.8;

}  // namespace

double StepOutlook::remaining() const {
    constexpr double unknown = std::numeric_limits<double>::quiet_NaN();
    if (steps_.size() < steps_needed) return unknown;
    const Step& last = steps_.back();
    const Step& first = steps_[steps_.size() - steps_needed];
    constexpr double between = steps_needed - 1;
    const double factor = std::pow(last.length / first.length, 1.0 / between);
    if (!(last.length > 0.0) || !(factor < slowest_factor)) return unknown;
    const double count = std::max(1.0, std::ceil(std::log(last.length / tolerance_) / -std::log(factor)));
    return count * std::chrono::duration<double>(last.time - first.time).count() / between;
}

StepOutlook::State StepOutlook::after(const std::string& minimisation, const estimator::StepReport& report,
                                      Clock::time_point now) {
    std::string words = minimisation.empty() ? std::string() : minimisation + ": ";
    if (report.phase == estimator::StepReport::Phase::uncertainty) {
        steps_.clear();
        return {words + fmt::format("uncertainties, objective {:.6g}", report.objective),
                std::numeric_limits<double>::quiet_NaN()};
    }
    // The first report of a minimisation has no step.
    const bool first = !std::isfinite(report.step);
    if (first || minimisation != minimisation_ || report.round != round_) steps_.clear();
    minimisation_ = minimisation;
    round_ = report.round;
    if (!first && !report.provisional) steps_.push_back({now, report.step});
    words += fmt::format("step {}, objective {:.6g}", report.iteration, report.objective);
    if (!first) words += fmt::format(", decrease {:.2g}, lambda {:.2g}", report.decrease, report.damping);
    if (report.provisional) words += ", intermediate stage";
    return {words, remaining()};
}

}  // namespace orbid::apps
