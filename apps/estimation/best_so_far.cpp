#include "apps/estimation/best_so_far.hpp"

#include <limits>
#include <utility>

namespace orbid::apps {

namespace {

constexpr auto stored_every = std::chrono::seconds(10);
constexpr double no_number = std::numeric_limits<double>::quiet_NaN();

}  // namespace

std::string interrupted_result(estimator::Estimate estimate, const ResultContext& context) {
    estimate.status = estimator::EstimateStatus::interrupted;
    if (estimate.message.empty()) estimate.message = "interrupted";
    return result_text(estimate, context);
}

BestSoFar::BestSoFar(const Workspace& work, const std::vector<estimator::FreeParameter>& parameters,
                     ResultContext context)
    : work_(work), content_(std::make_shared<Content>()) {
    content_->context = std::move(context);
    content_->estimate.objective = no_number;
    for (const estimator::FreeParameter& parameter : parameters) {
        estimator::Estimated& one = content_->estimate.parameters.emplace_back();
        one.name = parameter.name;
        one.unit = parameter.unit;
        one.start = parameter.start;
        one.value = one.sd = one.lower95 = one.upper95 = one.laplace_sd = one.data_share = no_number;
    }
    estimator::Estimate none;
    none.message = "interrupted before the estimate";
    work_.stop.shows(interrupted_result(none, content_->context));
}

void BestSoFar::reached(const Eigen::VectorXd& theta, double objective) {
    auto& parameters = content_->estimate.parameters;
    if (finished_ || theta.size() != std::ssize(parameters)) return;
    const bool first = content_->estimate.message.empty();
    for (std::size_t i = 0; i < parameters.size(); ++i)
        parameters[i].value = theta[static_cast<Eigen::Index>(i)];
    content_->estimate.objective = objective;
    content_->estimate.message = "interrupted within the estimate: the best values by then, without intervals";
    if (first)
        work_.stop.shows([content = content_] { return interrupted_result(content->estimate, content->context); });
    const auto now = std::chrono::steady_clock::now();
    if (now - stored_ < stored_every) return;
    stored_ = now;
    work_.folder.store("result.json", interrupted_result(content_->estimate, content_->context));
}

}  // namespace orbid::apps
