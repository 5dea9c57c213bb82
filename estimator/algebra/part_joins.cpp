#include "estimator/algebra/part_joins.hpp"

#include <array>
#include <cstddef>
#include <stdexcept>
#include <string>
#include <utility>

#include "estimator/algebra/r_factor.hpp"

namespace orbid::estimator {

namespace {

using Ends = std::array<Eigen::MatrixXd, 2>;

void put(const std::vector<ChainPart>& parts, const Eigen::MatrixXd& rest, RankNumbers& numbers) {
    numbers.put(static_cast<double>(parts.size()));
    for (const ChainPart& part : parts) {
        for (const double value : {static_cast<double>(part.first), static_cast<double>(part.last),
                                   part.earlier ? 1.0 : 0.0, part.later ? 1.0 : 0.0})
            numbers.put(value);
        for (const Eigen::MatrixXd* rows : {&part.rows, &part.own[0], &part.own[1]})
            numbers.put(*rows);
        numbers.put(Eigen::MatrixXd(part.limit));
    }
    numbers.put(rest);
}

std::vector<ChainPart> take_parts(RankNumbers& numbers) {
    std::vector<ChainPart> parts(static_cast<std::size_t>(numbers.take_index()));
    for (ChainPart& part : parts) {
        part.first = numbers.take_index();
        part.last = numbers.take_index();
        part.earlier = numbers.take() > 0.0;
        part.later = numbers.take() > 0.0;
        for (Eigen::MatrixXd* rows : {&part.rows, &part.own[0], &part.own[1]})
            *rows = numbers.take_matrix();
        part.limit = numbers.take_matrix();
    }
    return parts;
}

/// The node between two parts eliminated; of a whole chain its ends as well.
ChainFactor joined(const ChainPart& left, const ChainPart& right, Eigen::Index width, bool complete) {
    std::vector<ChainNode> nodes(3);
    nodes[0].latents = left.first;
    nodes[1].latents = left.last;
    nodes[2].latents = right.last;
    for (std::size_t i = 0; i < 3; ++i)
        nodes[i].block = i;
    nodes[0].own = &left.own[0];
    nodes[1].own = &right.own[0];
    nodes[1].alone = &left.own[1];
    nodes[2].own = &right.own[1];
    nodes[0].limit = left.limit.data();
    nodes[1].limit = right.limit.data();  // the second rank has the own rows of the node, and so its size
    nodes[2].limit = right.limit.data() + right.first;
    nodes[0].link = &left.rows;
    nodes[1].link = &right.rows;
    return factorise_chain(nodes, false, width - 1, !complete);
}

/// Values of three nodes, as those of the two parts between them.
Ends as_ends(const std::vector<Eigen::VectorXd>& z) {
    Ends ends;
    for (std::size_t i = 0; i < 2; ++i) {
        ends[i].resize(z[i].size() + z[i + 1].size(), 1);
        ends[i] << z[i], z[i + 1];
    }
    return ends;
}

std::vector<Eigen::VectorXd> known_ends(const ChainFactor& factor, const Eigen::MatrixXd& ends) {
    return {ends.col(0).head(factor.latents[0]), {}, ends.col(0).tail(factor.latents[2])};
}

}  // namespace

PartJoins::PartJoins(Collective& ranks, std::vector<ChainPart> own, Eigen::MatrixXd& rest)
    : ranks_(ranks), own_(own.size()) {
    ranks.begin(Collective::Operation::condense);
    const Eigen::Index width = rest.cols();
    std::vector<ChainPart>& parts = own;
    for (const int other : ranks.children()) {
        RankNumbers numbers = ranks.receive(other);
        std::vector<ChainPart> following = take_parts(numbers);
        const Eigen::MatrixXd other_rest = numbers.take_matrix();
        Join join;
        join.other = other;
        join.parts = parts.size();
        join.meets = !parts.empty() && parts.back().later;
        if (join.meets != (!following.empty() && following.front().earlier) ||
            (join.meets && parts.back().last != following.front().first) || other_rest.cols() != width)
            throw std::invalid_argument("ranks " + std::to_string(ranks.rank()) + " and " + std::to_string(other) +
                                        ": the ends of their parts of a chain do not fit together");
        Eigen::MatrixXd stacked(3 * width, width);
        stacked << rest, other_rest, Eigen::MatrixXd::Zero(width, width);
        if (join.meets) {
            const ChainPart left = std::move(parts.back());
            const ChainPart right = std::move(following.front());
            join.complete = !left.earlier && !right.later;
            join.factor = joined(left, right, width, join.complete);
            stacked.bottomRows(width) = join.factor.rest;
            parts.pop_back();
            following.erase(following.begin());
            if (!join.complete) {
                parts.push_back({left.first,
                                 right.last,
                                 left.earlier,
                                 right.later,
                                 join.factor.ends,
                                 {left.own[0], right.own[1]},
                                 {}});
                parts.back().limit.resize(left.first + right.last);
                parts.back().limit << left.limit.head(left.first), right.limit.tail(right.last);
            }
        }
        parts.insert(parts.end(), following.begin(), following.end());
        rest = upper_triangle(stacked);
        joins_.push_back(std::move(join));
    }
    if (ranks.parent() >= 0) {
        RankNumbers numbers;
        put(parts, rest, numbers);
        ranks.send(ranks.parent(), numbers);
    } else if (!parts.empty()) {
        throw std::invalid_argument("ranks: a chain goes on beyond the first or the last rank");
    }
    ranks.end_along_tree();
    ranks.tell({rest.data(), static_cast<std::size_t>(rest.size())});
}

/// Takes what is known of the ends of parts down the tree to the own parts.
/// @param whole   Ends of both parts of a whole chain from its factor. @param within  the same where the outer ends of
///                both together are known.
template <class Whole, class Within>
std::vector<Eigen::MatrixXd> PartJoins::descend(const Whole& whole, const Within& within) const {
    ranks_.begin(Collective::Operation::descend);
    std::vector<Eigen::MatrixXd> known;
    if (ranks_.parent() >= 0) {
        RankNumbers numbers = ranks_.receive(ranks_.parent());
        known.resize(static_cast<std::size_t>(numbers.take_index()));
        for (Eigen::MatrixXd& one : known)
            one = numbers.take_matrix();
    }
    for (auto join = joins_.rbegin(); join != joins_.rend(); ++join) {
        std::vector<Eigen::MatrixXd> own(known.begin(),
                                         known.begin() + static_cast<std::ptrdiff_t>(join->parts - join->meets));
        std::vector<Eigen::MatrixXd> other;
        std::size_t next = own.size();
        if (join->meets) {
            Ends ends = join->complete ? whole(join->factor) : within(join->factor, known[next++]);
            own.push_back(std::move(ends[0]));
            other.push_back(std::move(ends[1]));
        }
        other.insert(other.end(), known.begin() + static_cast<std::ptrdiff_t>(next), known.end());
        RankNumbers numbers;
        numbers.put(static_cast<double>(other.size()));
        for (const Eigen::MatrixXd& one : other)
            numbers.put(one);
        ranks_.send(join->other, numbers);
        known = std::move(own);
    }
    ranks_.end_along_tree();
    return known;
}

std::vector<Eigen::MatrixXd> PartJoins::solve(const Eigen::VectorXd& d) const {
    const auto solved = [&d](const ChainFactor& factor, std::vector<Eigen::VectorXd> z) {
        solve_chain(factor, d, z);
        return as_ends(z);
    };
    return descend([&](const ChainFactor& factor) { return solved(factor, std::vector<Eigen::VectorXd>(3)); },
                   [&](const ChainFactor& factor, const Eigen::MatrixXd& ends) {
                       return solved(factor, known_ends(factor, ends));
                   });
}

std::vector<Eigen::MatrixXd> PartJoins::covariance(const Eigen::MatrixXd& parameter_covariance) const {
    Ends ends;
    const CovarianceUse link = [&ends](std::size_t from, const Eigen::Ref<const Eigen::MatrixXd>& covariance) {
        ends[from] = covariance;
    };
    return descend(
        [&](const ChainFactor& factor) {
            chain_covariance(factor, parameter_covariance, {}, link);
            return ends;
        },
        [&](const ChainFactor& factor, const Eigen::MatrixXd& outer) {
            part_covariance(factor, outer, parameter_covariance, {}, link);
            return ends;
        });
}

std::vector<Eigen::MatrixXd> PartJoins::undecided() const {
    const auto marked = [](const ChainFactor& factor, std::vector<Eigen::VectorXd> flags) {
        for (std::size_t i = 0; i < 3; ++i)
            if (flags[i].size() == 0) flags[i].setZero(factor.latents[i]);
        for_undecided(factor, [&](std::size_t node, Eigen::Index state) { flags[node][state] = 1.0; });
        return as_ends(flags);
    };
    return descend([&](const ChainFactor& factor) { return marked(factor, std::vector<Eigen::VectorXd>(3)); },
                   [&](const ChainFactor& factor, const Eigen::MatrixXd& ends) {
                       return marked(factor, known_ends(factor, ends));
                   });
}

double PartJoins::log_abs_determinant() const {
    double sum = 0.0;
    for (const Join& join : joins_)
        if (join.meets) sum += estimator::log_abs_determinant(join.factor);
    return sum;
}

}  // namespace orbid::estimator
