#pragma once

#include <string>
#include <vector>

#include "estimator/interface/estimate_options.hpp"
#include "identification/problem/identification_result.hpp"

#pragma GCC visibility push(default)

namespace orbid::identification {

struct StageValue;

/// Watches an identification, stores what is finished and may stop it. All calls come from the calling thread, except
/// stopped() and at(). What is not overridden does nothing.
class Observer {
public:
    virtual ~Observer() = default;

    /// Asked between steps: true ends with what has been found, status `interrupted`.
    [[nodiscard]] virtual bool stopped() const { return false; }
    /// Asked within computations that are useless unless finished: true leaves them by models::Stopped.
    [[nodiscard]] virtual bool left() const { return false; }
    /// A computation that cannot be stopped from inside begins, or has ended.
    virtual void unstoppable(bool /*begins*/) {}

    /// A step of the work begins, such as "prediction": its name, units of work (0: unknown), and what they are.
    virtual void begin(const std::string& /*step*/, double /*total*/, const std::string& /*unit*/) {}
    /// `done` units of work, or steps of a minimisation, which `note` describes.
    virtual void at(double /*done*/, const std::string& /*note*/) {}
    virtual void end(const std::string& /*outcome*/) {}
    /// Work within a step or between two that may take long, such as "first solutions"; empty: it has ended.
    virtual void within(const std::string& /*work*/) {}
    /// A minimisation within the step: its name ("": that of the step), and where it is.
    /// Unless overridden it is told by at().
    virtual void step(const std::string& minimisation, const estimator::StepReport& report);
    /// The best values of the estimated parameters so far, and the objective there (of its step; nan: unknown).
    virtual void reached(const Eigen::VectorXd& /*theta*/, double /*objective*/) {}
    /// A step was not computed but recalled.
    virtual void recalled(const std::string& /*step*/, const std::string& /*outcome*/) {}
    /// Something to know, for whoever reads the results.
    virtual void remark(const std::string& /*line*/) {}
    /// A detail, for a log.
    virtual void detail(const std::string& /*line*/) {}

    /// Cycles were added to the measured ones.
    virtual void found(const orbits::CycleSearch& /*all*/) {}
    /// A stage has ended; `so_far` is what the result is by now.
    virtual void stage_ended(const IdentificationResult& /*so_far*/) {}
    /// All stages have ended; comparisons follow.
    virtual void estimated(const IdentificationResult& /*result*/) {}

    /// Values kept under a name by an earlier run of the same problem and options. With true an identification goes on
    /// from them, with the same result to the bit.
    [[nodiscard]] virtual bool recall(const std::string& /*name*/, StageValue& /*value*/) { return false; }
    virtual void keep(const std::string& /*name*/, StageValue& /*value*/) {}
    [[nodiscard]] virtual bool recall(const std::string& /*name*/, std::vector<MatchingResult>& /*value*/) {
        return false;
    }
    virtual void keep(const std::string& /*name*/, std::vector<MatchingResult>& /*value*/) {}
    [[nodiscard]] virtual bool recall(const std::string& /*name*/, ComparisonResult& /*value*/) { return false; }
    virtual void keep(const std::string& /*name*/, ComparisonResult& /*value*/) {}
    [[nodiscard]] virtual bool recall(const std::string& /*name*/, AlternativeResult& /*value*/) { return false; }
    virtual void keep(const std::string& /*name*/, AlternativeResult& /*value*/) {}
};

/// While it exists, a computation runs that cannot be stopped from inside.
class Unstoppable {
public:
    explicit Unstoppable(Observer& observer) : observer_(observer) { observer_.unstoppable(true); }
    ~Unstoppable() { observer_.unstoppable(false); }
    Unstoppable(const Unstoppable&) = delete;
    Unstoppable& operator=(const Unstoppable&) = delete;

private:
    Observer& observer_;
};

}  // namespace orbid::identification

#pragma GCC visibility pop
