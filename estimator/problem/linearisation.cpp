#include "estimator/problem/linearisation.hpp"

#include <algorithm>
#include <cassert>

#include "estimator/algebra/block_loop.hpp"

namespace orbid::estimator {

namespace {

/// Rows [d/dz | d/dz_next | d/du | value]: `latents` own states, `after` ones of the next block.
Eigen::MatrixXd joined(const Eigen::MatrixXd& by_z, Eigen::Index latents, const Eigen::MatrixXd& by_next,
                       Eigen::Index after, const Eigen::MatrixXd& by_theta, const Eigen::VectorXd& slope,
                       const Eigen::VectorXd& value) {
    Eigen::MatrixXd rows(value.size(), latents + after + slope.size() + 1);
    if (latents > 0) rows.leftCols(latents) = by_z;
    if (after > 0) rows.middleCols(latents, after) = by_next;
    rows.middleCols(latents + after, slope.size()).noalias() = by_theta * slope.asDiagonal();
    rows.rightCols(1) = value;
    return rows;
}

/// Records [de/dz | de/dz_next | de/du | e] of one part in the unit of its law, see joined().
LawRecords part_records(const ActiveBlock& block, const LawPart& part, const NoiseModel& law, const BlockValue& value,
                        const Eigen::VectorXd& slope, Eigen::Index after) {
    const auto count = static_cast<Eigen::Index>(part.records.size());
    const Eigen::Index before = block.latents + after;
    LawRecords records{{}, part.observed, count};
    const Eigen::VectorXd errors = law_errors(block, part, law, value.e);
    if (count == value.e.size()) {  // then the records are in order
        records.rows = joined(value.e_z, block.latents, value.e_next, after, value.e_theta, slope, errors);
    } else {
        records.rows.resize(count, before + slope.size() + 1);
        records.rows.rightCols(1) = errors;
        for (Eigen::Index i = 0; i < count; ++i) {
            const Eigen::Index from = part.records[static_cast<std::size_t>(i)];
            if (block.latents > 0) records.rows.row(i).head(block.latents) = value.e_z.row(from);
            if (after > 0) records.rows.row(i).segment(block.latents, after) = value.e_next.row(from);
            records.rows.row(i).segment(before, slope.size()) = value.e_theta.row(from).cwiseProduct(slope.transpose());
        }
    }
    const bool logarithmic = std::holds_alternative<LogNormalErrors>(law.distribution);
    for (Eigen::Index i = 0; i < count && (logarithmic || block.deviation.size() > 0); ++i) {
        const Eigen::Index record = part.records[static_cast<std::size_t>(i)];
        records.rows.row(i).head(before + slope.size()) /=
            logarithmic ? part.observed[i] - value.e[record] : block.deviation[record];
    }
    return records;
}

Eigen::MatrixXd in_basis(const Eigen::MatrixXd& rows, Eigen::Index before, const Eigen::MatrixXd& basis) {
    Eigen::MatrixXd reduced(rows.rows(), before + basis.cols() + 1);
    reduced.leftCols(before) = rows.leftCols(before);
    // A product of few rows is done entry by entry: the general one takes longer to begin than to multiply.
    if (rows.rows() < 8)
        reduced.middleCols(before, basis.cols()).noalias() = rows.middleCols(before, basis.rows()).lazyProduct(basis);
    else
        reduced.middleCols(before, basis.cols()).noalias() = rows.middleCols(before, basis.rows()) * basis;
    reduced.rightCols(1) = rows.rightCols(1);
    return reduced;
}

Eigen::VectorXd slopes_of(const std::vector<Coordinate>& coordinates, const Eigen::VectorXd& theta) {
    Eigen::VectorXd slope(theta.size());
    for (Eigen::Index i = 0; i < theta.size(); ++i)
        slope[i] = coordinates[static_cast<std::size_t>(i)].slope(theta[i]);
    return slope;
}

/// Rows of one block. @param slope  d theta / d u.
BlockRows linearised(const BlockSet& set, const std::vector<NoiseModel>& laws, const BlockValue& value,
                     const Eigen::VectorXd& slope, std::size_t b, bool compressed) {
    const ActiveBlock& block = set.blocks[b];
    BlockRows rows;
    rows.latents = block.latents;
    rows.cholesky = &block.cholesky;
    rows.next = block.next;
    rows.next_latents = block.next >= 0 ? set.blocks[static_cast<std::size_t>(block.next)].latents : 0;
    const auto take = [&](const std::vector<LawPart>& from, Eigen::Index after, std::vector<PartRows>& to) {
        to.reserve(from.size());
        for (const LawPart& part : from) {
            to.push_back({part.law, part_records(block, part, laws[part.law], value, slope, after)});
            // The R factor instead of the rows where that is shorter.
            Eigen::MatrixXd& own = to.back().records.rows;
            if (compressed && laws[part.law].compressible() && 2 * own.rows() > 3 * own.cols())
                own = upper_triangle(own);
        }
    };
    take(block.parts(), 0, rows.parts);
    take(block.linked_parts(), rows.next_latents, rows.linked_parts);
    if (block.cholesky.size() > 0) {
        rows.channel = block.channel();
        rows.rows = joined(value.e_z, block.latents, {}, 0, value.e_theta, slope, value.e);
    }
    if (block.constraints > 0)
        rows.link = block.constraint_size.cwiseInverse().asDiagonal() *
                    joined(value.c_z, block.latents, value.c_next, rows.next_latents, value.c_theta, slope, value.c);
    return rows;
}

}  // namespace

std::vector<BlockRows> linearise(const BlockSet& set, const std::vector<NoiseModel>& laws,
                                 const std::vector<BlockValue>& values, const std::vector<Coordinate>& coordinates,
                                 const Eigen::VectorXd& theta, bool compressed) {
    const Eigen::VectorXd slope = slopes_of(coordinates, theta);
    std::vector<BlockRows> result(set.blocks.size());
    for_blocks(set.blocks.size(),
               [&](std::size_t b) { result[b] = linearised(set, laws, values[b], slope, b, compressed); });
    return result;
}

std::vector<BlockRows> in_basis(const std::vector<BlockRows>& rows, const Eigen::MatrixXd& basis) {
    std::vector<BlockRows> result(rows.size());
    for_blocks(rows.size(), [&](std::size_t b) {
        const BlockRows& from = rows[b];
        BlockRows& to = result[b];
        to.latents = from.latents;
        to.next_latents = from.next_latents;
        to.next = from.next;
        to.cholesky = from.cholesky;
        to.channel = from.channel;
        const auto turn = [&](const std::vector<PartRows>& parts, Eigen::Index before, std::vector<PartRows>& turned) {
            turned.reserve(parts.size());
            for (const PartRows& part : parts)
                turned.push_back(
                    {part.law,
                     {in_basis(part.records.rows, before, basis), part.records.observed, part.records.count}});
        };
        turn(from.parts, from.latents, to.parts);
        turn(from.linked_parts, from.latents + from.next_latents, to.linked_parts);
        if (from.rows.size() > 0) to.rows = in_basis(from.rows, from.latents, basis);
        if (from.link.size() > 0) to.link = in_basis(from.link, from.link.cols() - basis.rows() - 1, basis);
    });
    return result;
}

bool has_one_curvature(const BlockSet& set, const std::vector<NoiseModel>& laws) {
    return std::all_of(set.blocks.begin(), set.blocks.end(), [&](const ActiveBlock& block) {
        const auto same = [&](const LawPart& part) { return laws[part.law].has_one_curvature(); };
        // Links are guarded in steps, and slack ones in expectation as well.
        const auto same_link = [&](const LawPart& part) { return same(part) || laws[part.law].slack; };
        return std::all_of(block.parts().begin(), block.parts().end(), same) &&
               std::all_of(block.linked_parts().begin(), block.linked_parts().end(), same_link);
    });
}

namespace {

/// Columns of parameters in a block's rows; `otherwise` where it has none.
Eigen::Index parameter_columns(const BlockRows& block, Eigen::Index otherwise) {
    if (!block.parts.empty()) return block.parts.front().records.rows.cols() - block.latents - 1;
    if (!block.linked_parts.empty())
        return block.linked_parts.front().records.rows.cols() - block.latents - block.next_latents - 1;
    return block.rows.size() > 0 ? block.rows.cols() - block.latents - 1 : otherwise;
}

/// Rows that link a block to the next one: constraints, then whitened linked records.
struct StandardLink {
    Eigen::MatrixXd rows;
    Eigen::Index records = 0;  ///< rows of linked records
    double value = 0.0;
};

StandardLink standard_link(const BlockRows& block, const std::vector<NoiseModel>& laws, const Eigen::VectorXd& psi,
                           double matching, Curvature curvature) {
    // Links that no longer hold (an interval on the wrong branch of a fold) are to be repaired. With the steps of far
    // outliers a section series with noise 5e-3 took 200 steps and more, guarded 29.
    WhitenedRows linked =
        standard_rows(block.linked_parts, laws, psi, curvature == Curvature::step ? Curvature::guarded : curvature);
    StandardLink link;
    link.value = linked.value;
    link.records = linked.rows.rows();
    const Eigen::Index constraints = block.link.rows();
    if (constraints == 0) {
        link.rows = std::move(linked.rows);
        return link;
    }
    link.rows.resize(constraints + link.records, block.link.cols());
    link.rows.topRows(constraints) = block.link / matching;
    if (link.records > 0) link.rows.bottomRows(link.records) = linked.rows;
    return link;
}

/// A^T w of rows [A | w] into `gradient`.
void take_gradient(const Eigen::MatrixXd& rows, Eigen::VectorXd& gradient) {
    const Eigen::Index columns = std::max<Eigen::Index>(rows.cols() - 1, 0);
    gradient.resize(columns);
    if (columns == 0) return;
    const double* const w = rows.data() + columns * rows.rows();
    for (Eigen::Index j = 0; j < columns; ++j) {
        const double* const column = rows.data() + j * rows.rows();
        double sum = 0.0;
        for (Eigen::Index k = 0; k < rows.rows(); ++k)
            sum += column[k] * w[k];
        gradient[j] = sum;
    }
}

/// A step of the own states, of those of the next block (null: the rows have none) and of the parameters.
double along(const Eigen::VectorXd& gradient, const Eigen::VectorXd& own, const Eigen::VectorXd* next,
             const Eigen::VectorXd& parameters) {
    double sum = 0.0;
    Eigen::Index column = 0;
    if (gradient.size() == 0) return sum;
    for (const Eigen::VectorXd* x : {&own, next, &parameters})
        for (Eigen::Index j = 0; x != nullptr && j < x->size(); ++j)
            sum += gradient[column++] * (*x)[j];
    return sum;
}

}  // namespace

Eigen::VectorXd slopes_along(const BlockSet& set, const std::vector<BlockValue>& values,
                             const std::vector<Coordinate>& coordinates, const Eigen::VectorXd& theta,
                             const std::vector<NoiseModel>& laws, const ErrorWeights& errors,
                             const std::vector<Direction>& directions) {
    const Eigen::VectorXd slope = slopes_of(coordinates, theta);
    const auto count = static_cast<Eigen::Index>(directions.size());
    std::vector<Eigen::VectorXd> part(pieces_of(set.blocks.size()), Eigen::VectorXd::Zero(count));
    for_pieces(set.blocks.size(), [&](std::size_t begin, std::size_t end, std::size_t piece) {
        Eigen::VectorXd own;
        Eigen::VectorXd link;
        for (std::size_t b = begin; b < end; ++b) {
            const BlockRows block = linearised(set, laws, values[b], slope, b, false);
            take_gradient(standard_rows(block, laws, errors.psi, errors.curvature).rows, own);
            const bool links = block.link.rows() > 0 || !block.linked_parts.empty();
            if (links)
                take_gradient(standard_link(block, laws, errors.psi, errors.matching, errors.curvature).rows, link);
            const auto next = static_cast<std::size_t>(std::max<std::ptrdiff_t>(block.next, 0));
            for (Eigen::Index i = 0; i < count; ++i) {
                const Direction& to = directions[static_cast<std::size_t>(i)];
                double& sum = part[piece][i];
                sum += along(own, to.latents[b], nullptr, to.parameters);
                if (links)
                    sum += along(link, to.latents[b], block.next >= 0 ? &to.latents[next] : nullptr, to.parameters);
            }
        }
    });
    Eigen::VectorXd sum = Eigen::VectorXd::Zero(count);
    for (const Eigen::VectorXd& one : part)
        sum += one;
    set.spread.sum(sum);
    return sum;
}

namespace {

/// Rows without a right-hand side that add curvature to the latent states.
void add_excess(const BlockRows& block, Eigen::MatrixXd& rows) {
    const Eigen::Index count = rows.rows();
    const Eigen::VectorXd length = rows.leftCols(block.latents).colwise().norm();
    rows.conservativeResize(count + block.latents, Eigen::NoChange);
    rows.bottomRows(block.latents).setZero();
    rows.bottomLeftCorner(block.latents, block.latents).diagonal() = std::sqrt(block.excess) * length;
}

}  // namespace

WhitenedArrow standard_arrow(const std::vector<BlockRows>& rows, const std::vector<NoiseModel>& laws,
                             const Eigen::VectorXd& psi, double matching, Curvature curvature, bool keep_rows,
                             bool factorised, const Spread& spread) {
    WhitenedArrow result;
    Eigen::Index parameters = 0;
    std::vector<char> in_chain(rows.size(), 0);
    for (std::size_t b = 0; b < rows.size(); ++b) {
        const BlockRows& block = rows[b];
        parameters = parameter_columns(block, parameters);
        if (block.link.rows() == 0 && block.linked_parts.empty()) continue;
        in_chain[b] = 1;
        if (block.next >= 0) in_chain[static_cast<std::size_t>(block.next)] = 1;
    }
    std::vector<BlockTriangle> blocks(rows.size());
    std::vector<double> value(pieces_of(rows.size()), 0.0);
    const auto as_it_is = [&](std::size_t b) {
        Eigen::Index count = rows[b].rows.rows();
        for (const PartRows& part : rows[b].parts)
            count += part.records.rows.rows() * laws[part.law].rows_per_record();
        return in_chain[b] != 0 && count <= rows[b].latents + parameters + 1;
    };
    bool all_as_they_are = true;
    for (std::size_t b = 0; keep_rows && all_as_they_are && b < rows.size(); ++b)
        all_as_they_are = as_it_is(b);
    if (keep_rows && !all_as_they_are) result.rows.resize(rows.size());
    result.linked_records.assign(rows.size(), 0);
    for_pieces(rows.size(), [&](std::size_t begin, std::size_t end, std::size_t piece) {
        for (std::size_t b = begin; b < end; ++b) {
            const BlockRows& block = rows[b];
            WhitenedRows standard = standard_rows(block, laws, psi, curvature);
            value[piece] += standard.value;
            if (standard.rows.size() == 0) standard.rows.resize(0, block.latents + parameters + 1);
            assert(as_it_is(b) == (in_chain[b] != 0 && standard.rows.rows() <= standard.rows.cols()));
            if (keep_rows && !as_it_is(b)) result.rows[b] = standard;
            if (block.excess > 0.0 && in_chain[b] != 0) add_excess(block, standard.rows);
            blocks[b] = in_chain[b] != 0 ? linked_block(std::move(standard.rows), block.latents)
                                         : block_triangle(std::move(standard.rows), block.latents);
            if (block.link.rows() == 0 && block.linked_parts.empty()) continue;
            StandardLink link = standard_link(block, laws, psi, matching, curvature);
            value[piece] += link.value;
            result.linked_records[b] = link.records;
            blocks[b].next = block.next;
            blocks[b].link = std::move(link.rows);
        }
    });
    for (const double part : value)
        result.value += part;
    result.value = spread.sum(result.value);
    if (factorised) {
        result.arrow = factorise(std::move(blocks), parameters, spread);
    } else {
        result.arrow.blocks = std::move(blocks);
        result.arrow.spread = spread;
    }
    return result;
}

}  // namespace orbid::estimator
