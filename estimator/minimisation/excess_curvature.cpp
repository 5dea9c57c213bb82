#include "estimator/minimisation/excess_curvature.hpp"

#include <algorithm>
#include <cmath>
#include <functional>
#include <utility>

#include "estimator/algebra/block_loop.hpp"

namespace orbid::estimator {

namespace {

/// Fewer blocks converge or not as a whole.
constexpr std::size_t fewest_blocks = 100;
/// Gains of whole steps that ask for no explanation, and for how many trials others are remembered.
constexpr double least_usual_gain = 0.7, largest_usual_gain = 1.4;
constexpr int trials_watched = 4;
/// The blocks that make up this share of all deviations from the model are at fault, if they are few.
constexpr double share_of_all = 0.5;
constexpr std::size_t most_at_fault = 10, blocks_for_one_at_fault = 5000;
/// At a kink a secant across it tells much, and the next one on one side of it nothing: what was learned fades slowly.
constexpr double kept_share = 0.25;
/// Beyond this a deviation is not by the block's own states; nor is it where they are not read, or in no chain.
constexpr double most_excess = 1000.0;
/// So much that a state stays.
constexpr double held_excess = 1e15;
/// Changes of the objective below this may be rounding.
constexpr double least_change = 1e-6;

}  // namespace

bool ExcessCurvature::possible() const {
    return set_.blocks.size() >= fewest_blocks && set_.latents > 0 && set_.constraints == 0 && !set_.provisional &&
           set_.spread.alone();
}

bool ExcessCurvature::hold(const std::vector<std::size_t>& blocks, std::size_t most) {
    std::map<std::size_t, double> next = excess_;
    for (const std::size_t b : blocks)
        next[b] = held_excess;
    const auto held = [](const std::map<std::size_t, double>& excess) {
        return static_cast<std::size_t>(
            std::count_if(excess.begin(), excess.end(), [](const auto& block) { return block.second == held_excess; }));
    };
    if (held(next) > most || held(next) == held(excess_)) return false;
    excess_ = std::move(next);
    return true;
}

std::size_t ExcessCurvature::release() {
    return std::erase_if(excess_, [](const auto& block) { return block.second == held_excess; });
}

void ExcessCurvature::expect(const BlockArrow& arrow, const TrialStep& step) {
    told_.clear();
    if (!possible() || (excess_.empty() && watched_ == 0)) return;
    told_ = model_changes(arrow, step.parameters.d, step.latents);
    square_.resize(told_.size());
    for_blocks(told_.size(), [&](std::size_t b) {
        const auto own = arrow.blocks[b].triangle.leftCols(step.latents[b].size());
        square_[b] = arrow.linked[b] ? own.colwise().squaredNorm().dot(step.latents[b].cwiseAbs2()) : 0.0;
    });
    for (const auto& [b, excess] : excess_) {
        // The model has the excess, and so do the block's own columns.
        square_[b] /= 1.0 + excess;
        told_[b] -= 0.5 * excess * square_[b];
    }
}

void ExcessCurvature::compare(const Eigen::VectorXd& psi, const BlockErrors& from, const std::vector<BlockValue>& to,
                              double gain) {
    const bool usual = gain > least_usual_gain && gain < largest_usual_gain;
    watched_ = usual ? std::max(watched_ - 1, 0) : trials_watched;
    if (told_.empty()) return;
    const std::vector<double> actual = value_changes(set_, problem_.laws, psi, from, BlockErrors(to));
    const auto secant = [&](std::size_t b) { return 2.0 * (actual[b] - told_[b]) / square_[b]; };
    for (auto& [b, excess] : excess_)
        if (excess < held_excess && 0.5 * std::max(excess, 1.0) * square_[b] > least_change)
            excess = std::clamp(std::max(secant(b), kept_share * excess), 0.0, most_excess);
    if (gain > least_usual_gain) return;
    double all = 0.0;
    std::vector<std::pair<double, std::size_t>> worse;
    for (std::size_t b = 0; b < told_.size(); ++b) {
        const double deviation = actual[b] - told_[b];
        all += std::abs(deviation);
        if (deviation > least_change) worse.emplace_back(deviation, b);
    }
    std::sort(worse.begin(), worse.end(), std::greater<>());
    double found = 0.0;
    std::size_t few = 0;
    while (few < worse.size() && !(found > share_of_all * all))
        found += worse[few++].first;
    if (!(found > share_of_all * all) || few > most_at_fault + told_.size() / blocks_for_one_at_fault) return;
    for (std::size_t i = 0; i < few; ++i)
        if (const std::size_t b = worse[i].second; secant(b) < most_excess) excess_.try_emplace(b, secant(b));
}

}  // namespace orbid::estimator
