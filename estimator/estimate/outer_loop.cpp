#include "estimator/estimate/outer_loop.hpp"

#include <algorithm>
#include <string>
#include <utility>

#include "estimator/problem/rank_share.hpp"
#include "models/system/stopped.hpp"

namespace orbid::estimator {

namespace {

std::string described(const Problem& problem, const BlockSet& set, const ActiveBlock& block) {
    return std::string(problem.residuals[block.residual]->type()) + " \"" + label_of(set, block) + "\"";
}

/// What changes of a set whose blocks stay.
ActiveSet without_blocks(ActiveSet set) {
    set.layout = {};
    set.latents.clear();
    return set;
}

/// Stages lower a continuity error by a factor of two at least: sixty cover more than the digits of a double.
constexpr int provisional_limit = 60;

}  // namespace

OuterLoop::OuterLoop(const Problem& problem, State& state, std::vector<ActiveSet> active)
    : problem_(problem), state_(state) {
    for (std::size_t r = 0; r < active.size(); ++r) {
        ResidualCount count{std::string(problem.residuals[r]->type()), 0, 0, 0, 0, {}};
        count.lost = static_cast<int>(std::count_if(active[r].layout.begin(), active[r].layout.end(),
                                                    [](const BlockLayout& block) { return !block.active; }));
        counts.push_back(count);
    }
    set.active = std::move(active);
}

/// Takes the stopped blocks out. False when too much would be lost: half of a residual's blocks or more.
bool OuterLoop::suspend_stopped() {
    if (half_of_a_residual(set, minimum.stopped)) return false;
    for (const std::size_t b : minimum.stopped) {
        const ActiveBlock& block = set.blocks[b];
        set.active[block.residual].layout.edit()[block.block].active = false;
        ++counts[block.residual].lost;
    }
    return true;
}

/// Blocks that are new, or came back, start from the latent states of the set.
void OuterLoop::adopt_latents(std::size_t residual, const std::vector<bool>& was_active) {
    const auto& fresh = set.active[residual].latents;
    const auto& layout = set.active[residual].layout;
    auto& latents = state_.latents[residual];
    latents.resize(layout.size());
    for (std::size_t b = 0; b < layout.size(); ++b) {
        const bool kept = b < was_active.size() && was_active[b] && latents[b].size() == layout[b].latents;
        if (!kept) latents[b] = fresh[b];
    }
}

bool OuterLoop::update_active_set() {
    bool changed = false;
    std::size_t first = 0;
    const Eigen::VectorXd all_scales = scales_of(problem_.laws, state_.psi);
    earlier_.clear();
    for (std::size_t r = 0; r < problem_.residuals.size(); ++r) {
        ActiveSet active = set.active[r];  // a stop leaves the set as it was
        std::vector<bool> was_active;
        for (const BlockLayout& block : active.layout)
            was_active.push_back(block.active);
        const Eigen::VectorXd scales =
            all_scales.segment(static_cast<Eigen::Index>(first), static_cast<Eigen::Index>(active.groups.size()));
        const RefreshReport report =
            problem_.residuals[r]->update_active_set(active, state_.theta, state_.latents[r], scales);
        if (problem_.ranks != nullptr)
            agree_on_set(*problem_.ranks, std::string(problem_.residuals[r]->type()), report.changed, active);
        first += active.groups.size();
        counts[r].lost += report.lost;
        counts[r].rejected += report.rejected;
        counts[r].added += report.added;
        earlier_.push_back(report.changed ? std::move(set.active[r]) : without_blocks(std::move(set.active[r])));
        set.active[r] = std::move(active);
        if (report.changed) adopt_latents(r, was_active);
        changed = changed || report.changed;
    }
    return changed;
}

/// The sets of the last minimisation, where the next one came to nothing.
void OuterLoop::restore() {
    for (std::size_t r = 0; r < earlier_.size(); ++r) {
        if (earlier_[r].layout.empty()) {
            earlier_[r].layout = std::move(set.active[r].layout);
            earlier_[r].latents = std::move(set.active[r].latents);
        }
        set.active[r] = std::move(earlier_[r]);
    }
    earlier_.clear();
}

/// Fixed scales as the sets have them now; in an intermediate stage the starts of the others as well.
void OuterLoop::read_scales(const BlockSet& next) {
    for (const NoiseModel& law : problem_.laws) {
        if (law.joint()) continue;
        const Channel& channel = problem_.channels[static_cast<std::size_t>(law.channels.front())];
        const double value = next.active[channel.residual].groups[static_cast<std::size_t>(channel.group)].scale.value;
        const ErrorCoordinate& scale = law.coordinates.front();
        if (value > 0.0 && (!scale.estimate || next.provisional)) state_.psi[law.first] = scale.at(value);
    }
}

/// Minimises with the sets at hand. @return false: there is nothing to minimise
bool OuterLoop::minimise_next() {
    BlockSet next = freeze(problem_.residuals, std::move(set.active), problem_.channels, problem_.laws);
    if (problem_.ranks != nullptr) {
        share_blocks(problem_, next);
        share_states(next, state_);
    }
    if (ledger.round > 1) read_scales(next);
    Minimum found;
    try {
        if (next.records > 0)
            found = minimise(problem_, next, state_, ledger, [this] {
                // What the last minimisation has come to is no longer needed.
                minimum = {};
                set.blocks = {};
            });
        else
            found.message = "no residual record takes part";
    } catch (const models::Stopped&) {
        set.active = std::move(next.active);
        throw;
    }
    earlier_.clear();
    set = std::move(next);
    minimum = std::move(found);
    return set.records > 0;
}

/// What the end of a minimisation asks for. @return whether another one follows
bool OuterLoop::go_on(int& provisional) {
    const int limit = problem_.options.maximum_rounds;
    if (set.provisional) ++provisional;
    const bool last = set.provisional ? provisional >= provisional_limit : ledger.round - provisional >= limit;
    const bool blocked = minimum.outcome == Outcome::start_failed || minimum.outcome == Outcome::blocks_stopped;
    const bool at_start = minimum.outcome == Outcome::start_failed;
    if (blocked && problem_.ranks != nullptr) {
        // A chain without one of its blocks would have to be cut anew.
        minimum.message =
            at_start ? "a block cannot be evaluated at the start" : "a block stopped three steps in a row";
        if (minimum.stopped.empty())
            minimum.message += ", on another rank";
        else
            minimum.message += ": " + described(problem_, set, set.blocks[minimum.stopped.front()]);
        return false;
    }
    if (blocked) {
        minimum.message = (at_start ? "cannot be evaluated at the start: " : "stopped three steps in a row: ") +
                          described(problem_, set, set.blocks[minimum.stopped.front()]) +
                          (minimum.stopped.size() > 1 ? " and " + std::to_string(minimum.stopped.size() - 1) +
                                                            " more of " + std::to_string(set.blocks.size()) + " blocks"
                                                      : "");
        if (last || !suspend_stopped()) return false;
        if (at_start) return true;
    } else if (minimum.outcome != Outcome::converged && minimum.outcome != Outcome::no_progress) {
        return false;
    }
    if (last) {
        if (set.provisional) {
            minimum.outcome = Outcome::iteration_limit;
            minimum.message = "still provisional after " + std::to_string(provisional_limit) + " rounds";
        } else if (limit > 1 && minimum.outcome == Outcome::converged) {
            minimum.outcome = Outcome::iteration_limit;
            minimum.message =
                "the limit of " + std::to_string(limit) + " rounds is reached while the set of blocks still changes";
        }
        return false;
    }
    const bool stopped = minimum.outcome == Outcome::blocks_stopped;
    return update_active_set() || stopped || set.provisional;
}

void OuterLoop::run() {
    int provisional = 0;
    State reached = state_;
    try {
        for (ledger.round = 1; minimise_next(); ++ledger.round) {
            reached = state_;
            if (!go_on(provisional)) break;
        }
    } catch (const models::Stopped&) {
        // Between two minimisations: what the last one has come to stays.
        restore();
        if (set.blocks.empty() || minimum.outcome == Outcome::start_failed) throw;
        state_ = std::move(reached);
        minimum.outcome = Outcome::interrupted;
        minimum.message = "interrupted after " + std::to_string(ledger.iterations) + " steps";
    }
}

}  // namespace orbid::estimator
