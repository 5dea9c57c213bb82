#include "estimator/problem/rank_share.hpp"

#include <algorithm>
#include <cmath>
#include <functional>
#include <stdexcept>
#include <vector>

namespace orbid::estimator {

namespace {

/// Throws on every rank where something is wrong on one of them; there it says what.
void require_everywhere(Collective& ranks, const std::string& wrong_here) {
    if (!ranks.any(!wrong_here.empty())) return;
    throw std::invalid_argument(wrong_here.empty() ? "the part of another rank is refused, see there" : wrong_here);
}

double fingerprint(const std::string& text) {
    // Exact in a double; the same on every machine, as std::hash need not be.
    double sum = 0.0;
    for (const char c : text)
        sum = std::fmod(257.0 * sum + static_cast<unsigned char>(c), 4294967291.0);
    return sum;
}

std::vector<double> common_numbers(const Problem& problem, const State& state) {
    const EstimateOptions& options = problem.options;
    std::vector<double> numbers{options.step_tolerance, options.relative_singular_value,
                                static_cast<double>(options.maximum_iterations),
                                static_cast<double>(options.maximum_rounds), static_cast<double>(options.variance)};
    for (std::size_t i = 0; i < problem.parameters.size(); ++i) {
        const FreeParameter& parameter = problem.parameters[i];
        const auto at = static_cast<Eigen::Index>(i);
        const Coordinate& coordinate = problem.coordinates[i];
        for (const double value :
             {fingerprint(parameter.name), parameter.start, problem.lower[at], problem.upper[at],
              parameter.typical_size, static_cast<double>(parameter.scale),
              std::isfinite(problem.lower[at]) ? 0.0 : 1.0, coordinate.term(parameter.prior, state.u[at]).value})
            numbers.push_back(value);
    }
    for (const NoiseModel& law : problem.laws)
        numbers.push_back(static_cast<double>(law.distribution.index()));
    for (const ErrorCoordinate& error : problem.errors)
        for (const double value : {fingerprint(error.name), error.start, error.estimate ? 1.0 : 0.0, error.upper})
            numbers.push_back(value);
    for (std::size_t c = 0; c < problem.channels.size(); ++c)
        numbers.push_back(fingerprint(group_of(problem, static_cast<int>(c)).name));
    return numbers;
}

/// A block that two ranks have must be where the chain can be cut.
std::string why_not_shared(const Problem& problem, const BlockSet& set) {
    if (!problem.share.begins_earlier && !problem.share.goes_on) return {};
    const std::string who = "residual \"" + std::string(problem.residuals.front()->type()) + "\": ";
    if (problem.residuals.size() != 1) return "a chain over ranks needs exactly one residual";
    if (problem.residuals.front()->structure() != LatentStructure::chain) return who + "is no chain";
    if (set.blocks.size() != set.active.front().layout.size())
        return who + "all blocks must be active where its chain goes on on another rank";
    if (set.blocks.size() < 2) return who + "a part of a chain needs two blocks or more";
    const ActiveBlock& last = set.blocks.back();
    if (problem.share.goes_on && (!last.channel().empty() || last.constraints > 0))
        return who + "block \"" + label_of(set, last) +
               "\", which the next rank has as well, must have no records or constraints here: they belong there";
    return {};
}

}  // namespace

void check_alike(const Problem& problem, const State& state) {
    const std::vector<double> own = common_numbers(problem, state);
    std::vector<double> size{static_cast<double>(own.size())};
    problem.ranks->tell(size);
    bool other = size[0] != static_cast<double>(own.size());
    std::vector<double> told = own;
    told.resize(static_cast<std::size_t>(size[0]), 0.0);
    problem.ranks->tell(told);
    for (std::size_t i = 0; i < std::min(own.size(), told.size()); ++i)
        other = other || !(own[i] == told[i] || (std::isnan(own[i]) && std::isnan(told[i])));
    require_everywhere(*problem.ranks, other ? "rank " + std::to_string(problem.ranks->rank()) +
                                                   " was given other parameters, groups or options than rank 0"
                                             : std::string());
}

void share_blocks(const Problem& problem, BlockSet& set) {
    Collective& ranks = *problem.ranks;
    require_everywhere(ranks, why_not_shared(problem, set));
    set.spread.ranks = &ranks;
    if (problem.share.begins_earlier) set.spread.before = 0;
    double shared = 0.0;
    if (problem.share.goes_on) {
        set.spread.after = std::ssize(set.blocks) - 1;
        shared = static_cast<double>(set.blocks.back().latents);
    }
    std::vector<double> sums{set.ln_det_shapes,
                             static_cast<double>(set.records),
                             static_cast<double>(set.latents) - shared,
                             static_cast<double>(set.constraints),
                             static_cast<double>(set.blocks.size()) - (problem.share.goes_on ? 1.0 : 0.0),
                             set.linked ? 1.0 : 0.0,
                             set.provisional ? 1.0 : 0.0};
    ranks.sum(sums);
    set.spread.sum(set.count);
    set.ln_det_shapes = sums[0];
    set.records = static_cast<Eigen::Index>(sums[1]);
    set.latents = static_cast<Eigen::Index>(sums[2]);
    set.constraints = static_cast<Eigen::Index>(sums[3]);
    set.all_blocks = static_cast<std::size_t>(sums[4]);
    set.linked = sums[5] > 0.0;
    set.provisional = sums[6] > 0.0;
}

void share_states(const BlockSet& set, State& state) {
    Collective& ranks = *set.spread.ranks;
    ranks.begin(Collective::Operation::neighbours);
    const auto states = [&](std::ptrdiff_t b) -> Eigen::VectorXd& {
        const ActiveBlock& block = set.blocks[static_cast<std::size_t>(b)];
        return state.latents[block.residual][block.block];
    };
    if (ranks.rank() > 0) {
        RankNumbers numbers;
        numbers.put(set.spread.before >= 0 ? Eigen::MatrixXd(states(set.spread.before)) : Eigen::MatrixXd(0, 1));
        ranks.send(ranks.rank() - 1, numbers);
    }
    std::string wrong;
    if (ranks.rank() + 1 < ranks.count()) {
        const Eigen::VectorXd next = ranks.receive(ranks.rank() + 1).take_matrix();
        const Eigen::Index own = set.spread.after >= 0 ? states(set.spread.after).size() : 0;
        if (next.size() != own)
            wrong = "ranks " + std::to_string(ranks.rank()) + " and " + std::to_string(ranks.rank() + 1) +
                    ": the block between them has " + std::to_string(own) + " and " + std::to_string(next.size()) +
                    " latent states";
        else if (own > 0)
            states(set.spread.after) = next;
    } else if (set.spread.after >= 0) {
        wrong = "the chain goes on beyond the last rank";
    }
    ranks.end_with_neighbours(1);
    if (ranks.rank() == 0 && set.spread.before >= 0) wrong = "the chain begins before the first rank";
    require_everywhere(ranks, wrong);
}

void agree_on_set(Collective& ranks, const std::string& residual, bool changed, ActiveSet& active) {
    require_everywhere(ranks, changed ? "residual \"" + residual +
                                            "\" changes its blocks between minimisations: that cannot be done over "
                                            "ranks"
                                      : std::string());
    std::vector<double> numbers{active.is_intermediate_stage ? 1.0 : 0.0};
    for (const Group& group : active.groups)
        numbers.insert(numbers.end(), {group.scale.value, group.floor});
    for (const Eigen::VectorXd& memory : active.memory)
        numbers.insert(numbers.end(), memory.begin(), memory.end());
    std::vector<double> size{static_cast<double>(numbers.size())};
    ranks.tell(size);
    require_everywhere(ranks, size[0] != static_cast<double>(numbers.size())
                                  ? "residual \"" + residual + "\" keeps another memory than on rank 0"
                                  : std::string());
    ranks.tell(numbers);
    std::size_t at = 0;
    active.is_intermediate_stage = numbers[at++] > 0.0;
    for (Group& group : active.groups) {
        group.scale.value = numbers[at++];
        group.floor = numbers[at++];
    }
    for (Eigen::VectorXd& memory : active.memory)
        for (double& value : memory)
            value = numbers[at++];
}

}  // namespace orbid::estimator
