#pragma once

#include <chrono>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include <Eigen/Core>

#include "apps/results/result_file.hpp"
#include "apps/stages/workspace.hpp"
#include "estimator/estimate/estimate.hpp"

namespace orbid::apps {

/// result.json of a run that is left with what it has come to.
[[nodiscard]] std::string interrupted_result(estimator::Estimate estimate, const ResultContext& context);

/// The best parameters of an estimate that no stage has finished yet. result.json shows them when the run is left, and
/// every ten seconds, so that a run that is killed leaves them too.
class BestSoFar {
public:
    /// The run shows that it was interrupted before the estimate, until something is reached.
    /// @param parameters  those of the estimate
    BestSoFar(const Workspace& work, const std::vector<estimator::FreeParameter>& parameters, ResultContext context);

    /// @param theta  the best values, shape (parameters); another shape is ignored
    void reached(const Eigen::VectorXd& theta, double objective);
    /// A stage has finished: from now on its estimate is the best.
    void finish() { finished_ = true; }

private:
    const Workspace& work_;
    bool finished_ = false;
    std::chrono::steady_clock::time_point stored_ = std::chrono::steady_clock::now();
    struct Content {
        estimator::Estimate estimate;
        ResultContext context;
    };
    std::shared_ptr<Content> content_;  ///< also of what the run shows, which may outlive this
};

}  // namespace orbid::apps
