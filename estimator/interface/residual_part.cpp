#include "estimator/interface/residual_part.hpp"

#include <algorithm>
#include <stdexcept>
#include <string>
#include <utility>

namespace orbid::estimator {

ResidualPart::ResidualPart(const Residual& whole, std::size_t begin, std::size_t end)
    : whole_(whole), begin_(begin), end_(end), whole_set_(whole.initial_set()) {
    std::vector<BlockLayout>& all = whole_set_.layout.edit();
    if (!(begin < end) || end > all.size())
        throw std::invalid_argument("part of residual \"" + std::string(whole.type()) + "\": blocks " +
                                    std::to_string(begin) + " to " + std::to_string(end) + " of " +
                                    std::to_string(all.size()));
    initial_ = {whole_set_.groups, {}, {}, whole_set_.is_intermediate_stage, whole_set_.memory};
    const auto links_on = [&all](std::size_t b) { return all[b].next >= 0; };
    share_ = {begin > 0 && links_on(begin - 1), links_on(end - 1)};
    for (std::size_t b = begin; b < end; ++b) {
        BlockLayout block = all[b];
        if (block.next >= 0 && block.next != static_cast<std::ptrdiff_t>(b) + 1)
            throw std::invalid_argument("part of residual \"" + std::string(whole.type()) + "\": block \"" +
                                        block.label + "\" is linked to another one than the following");
        if (block.next >= 0) block.next -= static_cast<std::ptrdiff_t>(begin);
        initial_.layout.edit().push_back(std::move(block));
        initial_.latents.push_back(whole_set_.latents[b]);
    }
    if (share_.goes_on) {
        BlockLayout shared;
        shared.label = all[end].label;
        shared.latents = all[end].latents;
        shared.active = all[end].active;
        initial_.layout.edit().push_back(std::move(shared));
        initial_.latents.push_back(whole_set_.latents[end]);
    }
    for (std::size_t b = 0; b < all.size(); ++b)
        if (b < begin || b >= end) all[b].active = false;
}

ResidualPart ResidualPart::of_rank(const Residual& whole, int rank, int count) {
    const std::vector<BlockLayout>& all = whole.layout();
    const auto ranks = static_cast<std::size_t>(count);
    const auto cut = [&](std::size_t r) {
        std::size_t at = r * all.size() / ranks;
        // The end of a chain alone is no part of it: it stays with the blocks before it.
        while (at > 0 && at < all.size() && all[at - 1].next >= 0 && all[at].next < 0)
            ++at;
        return at;
    };
    const auto own = static_cast<std::size_t>(rank);
    if (all.size() < 2 * ranks || !(cut(own) < cut(own + 1)))
        throw std::invalid_argument("residual \"" + std::string(whole.type()) + "\": " + std::to_string(all.size()) +
                                    " blocks are too few for " + std::to_string(count) +
                                    " ranks; each needs two or more");
    return {whole, cut(own), cut(own + 1)};
}

/// The set of the other residual that belongs to one of this part.
ActiveSet ResidualPart::whole_set(const ActiveSet& active) const {
    ActiveSet all = whole_set_;
    all.groups = active.groups;
    all.memory = active.memory;
    all.is_intermediate_stage = active.is_intermediate_stage;
    for (std::size_t b = begin_; b < end_; ++b)
        if (all.layout[b].active != active.layout[b - begin_].active)
            all.layout.edit()[b].active = active.layout[b - begin_].active;
    return all;
}

std::vector<Eigen::VectorXd> ResidualPart::whole_latents(const std::vector<Eigen::VectorXd>& latents) const {
    std::vector<Eigen::VectorXd> all = whole_set_.latents;
    std::copy(latents.begin(), latents.end(), all.begin() + static_cast<std::ptrdiff_t>(begin_));
    return all;
}

std::vector<BlockValue> ResidualPart::evaluate(const ActiveSet& active, const Eigen::VectorXd& theta,
                                               const std::vector<Eigen::VectorXd>& latents, bool derivatives) const {
    ActiveSet all = whole_set(active);
    // A block without records here: the other residual knows it as the next one of the last.
    if (share_.goes_on && all.layout[end_].active != active.layout.back().active)
        all.layout.edit()[end_].active = active.layout.back().active;
    std::vector<BlockValue> values = whole_.evaluate(all, theta, whole_latents(latents), derivatives);
    std::vector<BlockValue> part(std::make_move_iterator(values.begin() + static_cast<std::ptrdiff_t>(begin_)),
                                 std::make_move_iterator(values.begin() + static_cast<std::ptrdiff_t>(end_)));
    if (!share_.goes_on) return part;
    BlockValue shared;
    if (derivatives) {
        shared.e_theta.resize(0, theta.size());
        shared.e_z.resize(0, initial_.layout.back().latents);
    }
    part.push_back(std::move(shared));
    return part;
}

RefreshReport ResidualPart::update_active_set(ActiveSet& active, const Eigen::VectorXd& theta,
                                              const std::vector<Eigen::VectorXd>& latents,
                                              const Eigen::VectorXd& scales) const {
    ActiveSet all = whole_set(active);
    const RefreshReport report = whole_.update_active_set(all, theta, whole_latents(latents), scales);
    active.groups = std::move(all.groups);
    active.memory = std::move(all.memory);
    active.is_intermediate_stage = all.is_intermediate_stage;
    return report;
}

}  // namespace orbid::estimator
