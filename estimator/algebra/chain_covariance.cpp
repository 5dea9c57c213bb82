#include <utility>

#include "estimator/algebra/block_loop.hpp"
#include "estimator/algebra/chain.hpp"

namespace orbid::estimator {

namespace {

using Groups = std::initializer_list<std::pair<Eigen::Index, Eigen::Index>>;

/// Memory of one thread for the matrices of one elimination.
struct EliminationMatrices {
    Eigen::MatrixXd inverse;
    Eigen::MatrixXd gain;
    Eigen::MatrixXd joint;
    Eigen::MatrixXd of_node;  ///< one for each use: a matrix that changes its size asks for memory each time
    Eigen::MatrixXd of_link;
};

/// Covariance of (pivots, separator) from that of the separator s: z = G s + R^-1 noise, G = -R^-1 R_s.
void extend(const ChainLevel& level, const Elimination& step, const Eigen::Ref<const Eigen::MatrixXd>& separator,
            EliminationMatrices& space) {
    const Eigen::Index l = step.pivots;
    const Eigen::Index s = separator.rows();
    const Eigen::Index rank = step.rank;
    const Eigen::Map<const Eigen::MatrixXd> rows = level.rows(step);
    auto& [inverse, gain, joint, of_node, of_link] = space;
    inverse.setZero(l, rank);
    gain.setZero(l, s);
    joint.resize(l + s, l + s);
    // Plain loops: the matrices are as small as a state, and calls for general ones cost more than the sums.
    const auto pivot = [&](Eigen::Index k) { return level.order[step.first + static_cast<std::size_t>(k)]; };
    for (Eigen::Index j = 0; j < rank; ++j) {
        inverse(pivot(j), j) = 1.0 / rows(j, j);
        for (Eigen::Index k = j; k-- > 0;) {
            double sum = 0.0;
            for (Eigen::Index m = k + 1; m <= j; ++m)
                sum -= rows(k, m) * inverse(pivot(m), j);
            inverse(pivot(k), j) = sum / rows(k, k);
        }
    }
    for (Eigen::Index j = 0; j < s; ++j)
        for (Eigen::Index m = 0; m < rank; ++m) {
            const double right = rows(m, rank + j);
            for (Eigen::Index i = 0; i < l; ++i)
                gain(i, j) -= inverse(i, m) * right;
        }
    auto across = joint.topRightCorner(l, s);
    across.setZero();
    for (Eigen::Index j = 0; j < s; ++j)
        for (Eigen::Index m = 0; m < s; ++m) {
            const double right = separator(m, j);
            for (Eigen::Index i = 0; i < l; ++i)
                across(i, j) += gain(i, m) * right;
        }
    for (Eigen::Index i = 0; i < l; ++i)
        for (Eigen::Index j = 0; j <= i; ++j) {
            double own = 0.0;
            for (Eigen::Index m = 0; m < rank; ++m)
                own += inverse(i, m) * inverse(j, m);
            for (Eigen::Index m = 0; m < s; ++m)
                own += 0.5 * (across(i, m) * gain(j, m) + across(j, m) * gain(i, m));
            joint(i, j) = joint(j, i) = own;
        }
    for (Eigen::Index j = 0; j < s; ++j)
        for (Eigen::Index i = 0; i < l; ++i)
            joint(l + j, i) = across(i, j);
    joint.bottomRightCorner(s, s) = separator;
}

/// Rows and columns of groups (first, count) in another order; a group may be left out, or stand twice.
template <class Matrix>
void pick(const Eigen::MatrixXd& from, const Groups& groups, Matrix&& result) {
    Eigen::Index column = 0;
    for (const auto& [first_column, columns] : groups)
        for (Eigen::Index j = 0; j < columns; ++j, ++column) {
            Eigen::Index row = 0;
            for (const auto& [first_row, rows] : groups)
                for (Eigen::Index i = 0; i < rows; ++i, ++row)
                    result(row, column) = from(first_row + i, first_column + j);
        }
}

Eigen::Index size_of(const Groups& groups) {
    Eigen::Index size = 0;
    for (const auto& group : groups)
        size += group.second;
    return size;
}

/// Covariances of (z_left, z_right, y) of the links of a moment, one after the other.
struct Links {
    std::vector<double> values;
    std::vector<std::size_t> place;
    std::vector<Eigen::Index> size;

    void add(Eigen::Index edge_size) {
        place.push_back(cells_);
        size.push_back(edge_size);
        cells_ += static_cast<std::size_t>(edge_size * edge_size);
    }
    void allocate() { values.resize(cells_); }
    [[nodiscard]] Eigen::Map<Eigen::MatrixXd> operator[](std::size_t i) {
        return {values.data() + place[i], size[i], size[i]};
    }

private:
    std::size_t cells_ = 0;
};

/// Passes the rows and columns of some groups on.
void give(const Eigen::MatrixXd& from, const Groups& groups, EliminationMatrices& space, std::size_t to,
          const CovarianceUse& use) {
    if (!use) return;
    const Eigen::Index size = size_of(groups);
    Eigen::MatrixXd& picked = groups.size() == 2 ? space.of_node : space.of_link;
    picked.resize(size, size);
    pick(from, groups, picked);
    use(to, picked);
}

/// The covariances of a chain, from its last elimination to its first.
struct ChainCovariance {
    const ChainFactor& chain;
    const Eigen::MatrixXd& parameters;
    const CovarianceUse& node;
    const CovarianceUse& link;
    Eigen::Index r = parameters.rows();

    [[nodiscard]] Eigen::Index latents(std::ptrdiff_t i) const { return chain.latents[static_cast<std::size_t>(i)]; }
    [[nodiscard]] std::size_t block(std::ptrdiff_t i) const { return chain.block[static_cast<std::size_t>(i)]; }
    [[nodiscard]] Links last_nodes() const;
    [[nodiscard]] Links room(const ChainLevel& level, const Links& links) const;
    [[nodiscard]] Links cut(std::size_t at, Links& links) const;
};

/// The last one or two nodes; a link between them is an original one where no level comes before.
Links ChainCovariance::last_nodes() const {
    EliminationMatrices top;
    const ChainLevel& end = chain.levels.back();
    const Elimination& last = end.steps.front();
    extend(end, last, parameters, top);
    const bool pair = last.partner >= 0;
    const Eigen::Index l = latents(last.node);
    const Eigen::Index l_partner = pair ? latents(last.partner) : 0;
    const Eigen::Index y = l + l_partner;
    give(top.joint, {{0, l}, {y, r}}, top, block(last.node), node);
    if (pair) give(top.joint, {{l, l_partner}, {y, r}}, top, block(last.partner), node);
    Links links;
    const bool bottom = chain.levels.size() == 1;
    const auto begin_with = [&](const Groups& groups, std::ptrdiff_t from) {
        if (bottom) {
            give(top.joint, groups, top, block(from), link);
            return;
        }
        const std::size_t i = links.place.size();
        links.add(size_of(groups));
        links.allocate();
        pick(top.joint, groups, links[i]);
    };
    if (pair) begin_with({{0, l}, {l, l_partner}, {y, r}}, last.node);
    if (pair && chain.cyclic) begin_with({{l, l_partner}, {0, l}, {y, r}}, last.partner);
    if (!pair && chain.cyclic) begin_with({{0, l}, {0, l}, {y, r}}, last.node);
    return links;
}

/// Places for the links that the nodes of a level cut, two for each, and for those that stay.
Links ChainCovariance::room(const ChainLevel& level, const Links& links) const {
    Links next;
    for (const Elimination& step : level.steps) {
        next.add(latents(step.left) + latents(step.node) + r);
        next.add(latents(step.node) + latents(step.right) + r);
    }
    for (std::size_t i = level.steps.size(); i < links.place.size(); ++i)
        next.add(links.size[i]);
    next.allocate();
    return next;
}

/// The nodes of a level, from the links between those that were left after it.
Links ChainCovariance::cut(std::size_t at, Links& links) const {
    const ChainLevel& level = chain.levels[at];
    const std::size_t count = level.steps.size();
    const bool original = at == 0;
    Links next = original ? Links() : room(level, links);
    for_pieces(count, [&](std::size_t begin, std::size_t finish, std::size_t) {
        EliminationMatrices space;
        for (std::size_t k = begin; k < finish; ++k) {
            const Elimination& step = level.steps[k];
            const Eigen::Index l_own = latents(step.node);
            const Eigen::Index l_left = latents(step.left);
            const Eigen::Index l_right = latents(step.right);
            const Eigen::Index common = l_own + l_left + l_right;
            extend(level, step, links[k], space);
            give(space.joint, {{0, l_own}, {common, r}}, space, block(step.node), node);
            const Groups before{{l_own, l_left}, {0, l_own}, {common, r}};
            const Groups after{{0, l_own}, {l_own + l_left, l_right}, {common, r}};
            if (original) {
                give(space.joint, before, space, block(step.left), link);
                give(space.joint, after, space, block(step.node), link);
            } else {
                pick(space.joint, before, next[2 * k]);
                pick(space.joint, after, next[2 * k + 1]);
            }
        }
    });
    // Links that this level does not cut: the end of an even open chain, the last one of an odd ring.
    for (std::size_t i = count; i < links.place.size(); ++i) {
        if (original) {
            const std::size_t from = chain.cyclic ? chain.block.size() - 1 : chain.block.size() - 2;
            if (link) link(chain.block[from], links[i]);
        } else {
            next[2 * count + (i - count)] = links[i];
        }
    }
    return next;
}

}  // namespace

void chain_covariance(const ChainFactor& chain, const Eigen::MatrixXd& parameter_covariance, const CovarianceUse& node,
                      const CovarianceUse& link) {
    const ChainCovariance walk{chain, parameter_covariance, node, link};
    Links links = walk.last_nodes();
    for (std::size_t at = chain.levels.size() - 1; at-- > 0;)
        links = walk.cut(at, links);
}

void part_covariance(const ChainFactor& part, const Eigen::MatrixXd& ends, const Eigen::MatrixXd& parameter_covariance,
                     const CovarianceUse& node, const CovarianceUse& link) {
    const ChainCovariance walk{part, parameter_covariance, node, link};
    EliminationMatrices space;
    const Eigen::Index l = part.latents.front();
    const Eigen::Index l_last = part.latents.back();
    const Eigen::Index y = l + l_last;
    give(ends, {{0, l}, {y, walk.r}}, space, part.block.front(), node);
    give(ends, {{l, l_last}, {y, walk.r}}, space, part.block.back(), node);
    if (part.levels.empty()) {
        if (link) link(part.block.front(), ends);
        return;
    }
    Links links;
    links.add(ends.rows());
    links.allocate();
    links[0] = ends;
    for (std::size_t at = part.levels.size(); at-- > 0;)
        links = walk.cut(at, links);
}

}  // namespace orbid::estimator
