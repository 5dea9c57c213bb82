#pragma once

#include <chrono>
#include <string>
#include <vector>

#include "estimator/interface/estimate_options.hpp"

namespace orbid::apps {

/// What is told of a minimisation under way: its state in words, and how long it will still take.
///
/// Near a minimum the full step, in posterior sds, shrinks by about the same factor from step to step. From the last
/// few the number of steps follows until it is below the tolerance at which the minimisation ends. While it does not
/// shrink nothing is foreseen.
class StepOutlook {
public:
    using Clock = std::chrono::steady_clock;

    /// @param tolerance  EstimateOptions::step_tolerance
    explicit StepOutlook(double tolerance) : tolerance_(tolerance) {}

    struct State {
        std::string words;   ///< "step 12, objective 345.6, decrease 0.012, lambda 0"
        double remaining_s;  ///< nan: unknown
    };
    /// @param minimisation  its name; "": none
    [[nodiscard]] State after(const std::string& minimisation, const estimator::StepReport& report,
                              Clock::time_point now = Clock::now());

private:
    [[nodiscard]] double remaining() const;

    struct Step {
        Clock::time_point time;
        double length;
    };
    double tolerance_;
    std::string minimisation_;
    int round_ = 0;
    std::vector<Step> steps_;  ///< of one round of one minimisation
};

}  // namespace orbid::apps
