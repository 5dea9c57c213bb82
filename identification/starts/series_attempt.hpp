#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <limits>
#include <string>
#include <vector>

#include <Eigen/Core>

#include "estimator/estimate/estimate.hpp"
#include "identification/problem/estimate_setup.hpp"
#include "identification/problem/problem_residuals.hpp"
#include "identification/starts/course_repair.hpp"
#include "identification/starts/series_nodes.hpp"

namespace orbid::identification {

/// What a search for a start tells while it goes on. Anything may be empty.
struct SeriesSearch {
    estimator::EstimateOptions estimate;  ///< of the final estimate; attempts are rougher
    SignChoices signs{};                  ///< that nothing tells
    std::function<void(const std::string& attempt, const estimator::StepReport& report)> watched{};
    std::function<void(const std::string& line)> log{};
    std::function<void(const std::string& line)> remark{};
    std::function<void(const Eigen::VectorXd& theta)> reached{};
};

/// What an attempt at a start of series with nodes has come to.
struct SeriesAttempt {
    SeriesStart start;  ///< `follows`: it explains the readings
    estimator::Estimate estimate;
    double misfit = std::numeric_limits<double>::infinity();  ///< what readings and links miss; less is better
    bool cut = false;                                         ///< ended because it would have cost too much

    /// At a minimum, or after all its steps.
    [[nodiscard]] bool has_ended() const {
        return estimate.status == estimator::EstimateStatus::converged ||
               estimate.status == estimator::EstimateStatus::iteration_limit;
    }
};

/// Parameters with a normal prior about their start, where they have none, nor a joint one; its sd is `width` times the
/// start.
[[nodiscard]] std::vector<estimator::FreeParameter> held_near(
    std::vector<estimator::FreeParameter> parameters, const std::vector<estimator::JointNormalPrior>& joint_priors,
    double width);

/// Estimates with exact matching that show whether a start leads anywhere: rough, in few steps, and with priors half
/// as wide as the starts of the parameters are large.
class SeriesAttempts {
public:
    /// The arguments outlive the attempts.
    SeriesAttempts(const IdentificationProblem& problem, const EstimateSetup& setup,
                   const std::vector<estimator::FreeParameter>& parameters, const SeriesSearch& search)
        : problem_(problem), setup_(setup), parameters_(parameters), search_(search) {}

    /// @param start  with intervals, and nodes unless they are to be guessed.
    /// @throws orbits::DataError when the data do not suffice.
    [[nodiscard]] SeriesAttempt make(const std::string& name, const SeriesStart& start);

    /// The same from its nodes with the signs of the starts, where those explain the readings as well: a sign that
    /// nothing tells (l in l^2) is not to change.
    [[nodiscard]] SeriesAttempt with_signs_of_start(SeriesAttempt found);

    /// The same, on the other side of a symmetry wherever that suits the readings better; see repaired_course().
    [[nodiscard]] SeriesAttempt on_better_sides(SeriesAttempt found);

    /// What all attempts have cost, see ShootingResidual::work() and orbits::track_states().
    [[nodiscard]] std::uint64_t work() const { return work_; }
    /// An attempt ends where its own work would exceed `one`, or that of all `all`; at first there is no limit.
    void limit(std::uint64_t one, std::uint64_t all) {
        most_of_one_ = one;
        most_work_ = all;
    }

private:
    [[nodiscard]] std::ptrdiff_t changed_signs(const SeriesAttempt& one) const;
    void go_on(std::vector<estimator::FreeParameter> near, ProblemResiduals& residuals,
               const estimator::EstimateOptions& options, estimator::Estimate& estimate) const;
    [[nodiscard]] std::vector<double> reading_sds(std::size_t place, const orbits::ShootingResidual& residual,
                                                  const estimator::Estimate& estimate) const;

    const IdentificationProblem& problem_;
    const EstimateSetup& setup_;
    const std::vector<estimator::FreeParameter>& parameters_;
    const SeriesSearch& search_;
    bool reached_ = false;  ///< an attempt has come to something
    FollowedRecords followed_;
    static constexpr std::uint64_t any_work = std::numeric_limits<std::uint64_t>::max();
    std::uint64_t repair_work_ = 0;  ///< apart: a course that only has to change sides is nearly found
    std::uint64_t work_ = 0, most_of_one_ = any_work, most_work_ = any_work;
};

}  // namespace orbid::identification
