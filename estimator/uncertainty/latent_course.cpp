#include "estimator/uncertainty/latent_course.hpp"

#include <cstddef>

namespace orbid::estimator {

LatentCourse::LatentCourse(const BlockArrow& arrow, const ReducedProblem& reduced_problem) {
    const Eigen::Index q = arrow.parameters;
    Eigen::Index states = 0;
    for (const BlockTriangle& block : arrow.blocks) {
        count_.push_back(block.latents);
        states += block.latents;
    }
    slopes_.resize(q, states);
    if (states == 0) return;
    const std::vector<Eigen::VectorXd> still = latent_steps(arrow, reduced_problem, Eigen::VectorXd::Zero(q));
    for (Eigen::Index i = 0; i < q; ++i) {
        const std::vector<Eigen::VectorXd> moved = latent_steps(arrow, reduced_problem, Eigen::VectorXd::Unit(q, i));
        Eigen::Index at = 0;
        for (std::size_t b = 0; b < moved.size(); ++b)
            for (Eigen::Index k = 0; k < count_[b]; ++k)
                slopes_(i, at++) = moved[b][k] - still[b][k];
    }
}

void LatentCourse::follow(const Eigen::VectorXd& d, const BlockSet& set, Latents& latents) const {
    Eigen::Index at = 0;
    for (std::size_t b = 0; b < count_.size(); ++b) {
        Eigen::VectorXd& z = latents[set.blocks[b].residual][set.blocks[b].block];
        for (Eigen::Index k = 0; k < count_[b]; ++k, ++at)
            z[k] += slopes_.col(at).dot(d);
    }
}

std::vector<Eigen::VectorXd> LatentCourse::along(Eigen::Index parameter) const {
    std::vector<Eigen::VectorXd> slopes(count_.size());
    Eigen::Index at = 0;
    for (std::size_t b = 0; b < count_.size(); ++b) {
        slopes[b] = slopes_.row(parameter).segment(at, count_[b]).transpose();
        at += count_[b];
    }
    return slopes;
}

}  // namespace orbid::estimator
