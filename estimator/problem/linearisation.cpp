#include "estimator/problem/linearisation.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "estimator/algebra/block_loop.hpp"

namespace orbid::estimator {

namespace {

/// Records [de/dz | de/dz_next | de/du | e] of one part in the unit of its law; `after` latent states of the next
/// block, 0 where the records do not depend on them.
LawRecords part_records(const ActiveBlock& block, const LawPart& part, const NoiseModel& law, const BlockValue& value,
                        const Eigen::VectorXd& slope, Eigen::Index after) {
    const auto count = static_cast<Eigen::Index>(part.records.size());
    const Eigen::Index before = block.latents + after;
    LawRecords records{{}, part.observed, count};
    records.rows.resize(count, before + slope.size() + 1);
    const bool all = count == value.e.size();  // then the records are in order
    if (all) {
        if (block.latents > 0) records.rows.leftCols(block.latents) = value.e_z;
        if (after > 0) records.rows.middleCols(block.latents, after) = value.e_next;
        records.rows.middleCols(before, slope.size()).noalias() = value.e_theta * slope.asDiagonal();
    } else {
        for (Eigen::Index i = 0; i < count; ++i) {
            const Eigen::Index from = part.records[static_cast<std::size_t>(i)];
            if (block.latents > 0) records.rows.row(i).head(block.latents) = value.e_z.row(from);
            if (after > 0) records.rows.row(i).segment(block.latents, after) = value.e_next.row(from);
            records.rows.row(i).segment(before, slope.size()) = value.e_theta.row(from).cwiseProduct(slope.transpose());
        }
    }
    records.rows.rightCols(1) = law_errors(block, part, law, value.e);
    const auto derivatives = records.rows.leftCols(records.rows.cols() - 1);
    if (std::holds_alternative<LogNormalErrors>(law.distribution)) {
        for (Eigen::Index i = 0; i < count; ++i)
            records.rows.row(i).head(derivatives.cols()) /=
                part.observed[i] - value.e[part.records[static_cast<std::size_t>(i)]];
    } else if (block.deviation.size() > 0) {
        for (Eigen::Index i = 0; i < count; ++i)
            records.rows.row(i).head(derivatives.cols()) /= block.deviation[part.records[static_cast<std::size_t>(i)]];
    }
    return records;
}

/// Replaces the rows by their R factor where that is shorter.
void compress(LawRecords& records) {
    const Eigen::Index columns = records.rows.cols();
    if (records.rows.rows() <= 2 * columns) return;
    records.rows = upper_triangle(std::move(records.rows));
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

Eigen::VectorXd own(const NoiseModel& law, const Eigen::VectorXd& psi) {
    return psi.segment(law.first, static_cast<Eigen::Index>(law.coordinates.size()));
}

}  // namespace

std::vector<BlockRows> linearise(const BlockSet& set, const std::vector<NoiseModel>& laws,
                                 const std::vector<BlockValue>& values, const std::vector<Coordinate>& coordinates,
                                 const Eigen::VectorXd& theta, bool compressed) {
    Eigen::VectorXd slope(theta.size());
    for (Eigen::Index i = 0; i < theta.size(); ++i)
        slope[i] = coordinates[static_cast<std::size_t>(i)].slope(theta[i]);
    std::vector<BlockRows> result(set.blocks.size());
    const auto linearise_block = [&](std::size_t b) {
        const ActiveBlock& block = set.blocks[b];
        const BlockValue& value = values[b];
        BlockRows& rows = result[b];
        rows.latents = block.latents;
        rows.cholesky = &block.cholesky;
        rows.next = block.next;
        rows.next_latents = block.next >= 0 ? set.blocks[static_cast<std::size_t>(block.next)].latents : 0;
        const auto take = [&](const std::vector<LawPart>& from, Eigen::Index after, std::vector<PartRows>& to) {
            to.reserve(from.size());
            for (const LawPart& part : from) {
                to.push_back({part.law, part_records(block, part, laws[part.law], value, slope, after)});
                if (compressed && laws[part.law].compressible()) compress(to.back().records);
            }
        };
        take(block.parts, 0, rows.parts);
        take(block.linked_parts, rows.next_latents, rows.linked_parts);
        if (block.cholesky.size() > 0) {
            rows.channel = block.channel;
            rows.rows.resize(value.e.size(), block.latents + theta.size() + 1);
            if (block.latents > 0) rows.rows.leftCols(block.latents) = value.e_z;
            rows.rows.middleCols(block.latents, theta.size()) = value.e_theta * slope.asDiagonal();
            rows.rows.rightCols(1) = value.e;
        }
        if (block.constraints > 0) {
            const Eigen::Index after = rows.next_latents;
            rows.link.resize(block.constraints, block.latents + after + theta.size() + 1);
            if (block.latents > 0) rows.link.leftCols(block.latents) = value.c_z;
            if (after > 0) rows.link.middleCols(block.latents, after) = value.c_next;
            rows.link.middleCols(block.latents + after, theta.size()) = value.c_theta * slope.asDiagonal();
            rows.link.rightCols(1) = value.c;
            rows.link = block.constraint_size.cwiseInverse().asDiagonal() * rows.link;
        }
    };
    for_pieces(set.blocks.size(), [&](std::size_t begin, std::size_t end, std::size_t) {
        for (std::size_t b = begin; b < end; ++b)
            linearise_block(b);
    });
    return result;
}

std::vector<BlockRows> in_basis(const std::vector<BlockRows>& rows, const Eigen::MatrixXd& basis) {
    std::vector<BlockRows> result(rows.size());
    for_pieces(rows.size(), [&](std::size_t begin, std::size_t end, std::size_t) {
        for (std::size_t b = begin; b < end; ++b) {
            const BlockRows& from = rows[b];
            BlockRows& to = result[b];
            to.latents = from.latents;
            to.next_latents = from.next_latents;
            to.next = from.next;
            to.cholesky = from.cholesky;
            to.channel = from.channel;
            const auto turn = [&](const std::vector<PartRows>& parts, Eigen::Index before,
                                  std::vector<PartRows>& turned) {
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
        }
    });
    return result;
}

int rows_per_record(const NoiseModel& law) {
    return std::holds_alternative<RelativeErrors>(law.distribution) ? 2 : 1;
}

WhitenedRows<double> standard_rows(const BlockRows& block, const std::vector<NoiseModel>& laws,
                                   const Eigen::VectorXd& psi, Curvature curvature) {
    WhitenedRows<double> result;
    if (block.rows.size() > 0) {
        const Eigen::VectorXd scale = scales_of(laws, psi);
        result.rows = block.rows;
        whiten(block.channel, *block.cholesky, scale, result.rows);
        result.value = 0.5 * result.rows.rightCols(1).squaredNorm() +
                       0.5 * std::log(2.0 * std::numbers::pi) * static_cast<double>(block.channel.size());
        for (const int c : block.channel)
            result.value += std::log(scale[c]);
        return result;
    }
    return standard_rows(block.parts, laws, psi, curvature);
}

WhitenedRows<double> standard_rows(const std::vector<PartRows>& from, const std::vector<NoiseModel>& laws,
                                   const Eigen::VectorXd& psi, Curvature curvature) {
    WhitenedRows<double> result;
    if (from.size() == 1) {
        const PartRows& part = from.front();
        return whitened_rows<double>(laws[part.law], part.records, own(laws[part.law], psi), curvature);
    }
    std::vector<WhitenedRows<double>> parts;
    Eigen::Index count = 0;
    for (const PartRows& part : from) {
        parts.push_back(whitened_rows<double>(laws[part.law], part.records, own(laws[part.law], psi), curvature));
        count += parts.back().rows.rows();
        result.value += parts.back().value;
    }
    if (parts.empty()) return result;
    result.rows.resize(count, parts.front().rows.cols());
    Eigen::Index row = 0;
    for (const WhitenedRows<double>& part : parts) {
        result.rows.middleRows(row, part.rows.rows()) = part.rows;
        row += part.rows.rows();
    }
    return result;
}

WhitenedRows<double> standard_rows_derivative(const BlockRows& block, const std::vector<NoiseModel>& laws,
                                              const Eigen::VectorXd& psi, Eigen::Index k, Curvature curvature,
                                              const WhitenedRows<double>& at) {
    WhitenedRows<double> result;
    result.rows = Eigen::MatrixXd::Zero(at.rows.rows(), at.rows.cols());
    if (block.rows.size() > 0) {
        // d(L^-1 D^-1 A) = -L^-1 E_g L (L^-1 D^-1 A), E_g picks the rows of the channel.
        const auto lower = block.cholesky->triangularView<Eigen::Lower>();
        bool present = false;
        Eigen::MatrixXd picked = lower * at.rows;
        for (std::size_t i = 0; i < block.channel.size(); ++i) {
            const auto row = static_cast<Eigen::Index>(i);
            const bool own_row = std::any_of(laws.begin(), laws.end(), [&](const NoiseModel& law) {
                return law.first == k && law.channels.front() == block.channel[i];
            });
            if (own_row) {
                present = true;
                result.value += 1.0;
            } else {
                picked.row(row).setZero();
            }
        }
        if (!present) return result;
        lower.solveInPlace(picked);
        result.rows = -picked;
        result.value += result.rows.rightCols(1).col(0).dot(at.rows.rightCols(1).col(0));
        return result;
    }
    return standard_rows_derivative(block.parts, laws, psi, k, curvature, at);
}

WhitenedRows<double> standard_rows_derivative(const std::vector<PartRows>& parts, const std::vector<NoiseModel>& laws,
                                              const Eigen::VectorXd& psi, Eigen::Index k, Curvature curvature,
                                              const WhitenedRows<double>& at) {
    WhitenedRows<double> result;
    result.rows = Eigen::MatrixXd::Zero(at.rows.rows(), at.rows.cols());
    Eigen::Index row = 0;
    for (const PartRows& part : parts) {
        const NoiseModel& law = laws[part.law];
        const auto size = static_cast<Eigen::Index>(law.coordinates.size());
        if (k < law.first || k >= law.first + size) {
            row += part.records.rows.rows() * rows_per_record(law);
            continue;
        }
        if (law.compressible()) {
            // S = A / s.
            const Eigen::Index rows = part.records.rows.rows();
            result.rows.middleRows(row, rows) = -at.rows.middleRows(row, rows);
            result.value =
                static_cast<double>(part.records.count) - at.rows.middleRows(row, rows).rightCols(1).squaredNorm();
            return result;
        }
        constexpr double h = 1e-30;
        Eigen::VectorXcd shifted = own(law, psi).cast<std::complex<double>>();
        shifted[k - law.first] += std::complex<double>(0.0, h);
        const auto derivative = whitened_rows<std::complex<double>>(law, part.records, shifted, curvature);
        result.rows.middleRows(row, derivative.rows.rows()) = derivative.rows.imag() / h;
        result.value = derivative.value.imag() / h;
        return result;
    }
    return result;
}

WhitenedArrow standard_arrow(const std::vector<BlockRows>& rows, const std::vector<NoiseModel>& laws,
                             const Eigen::VectorXd& psi, double matching, Curvature curvature, bool keep_rows,
                             bool factorised) {
    WhitenedArrow result;
    Eigen::Index parameters = 0;
    std::vector<char> in_chain(rows.size(), 0);
    for (std::size_t b = 0; b < rows.size(); ++b) {
        const BlockRows& block = rows[b];
        if (!block.parts.empty())
            parameters = block.parts.front().records.rows.cols() - block.latents - 1;
        else if (!block.linked_parts.empty())
            parameters = block.linked_parts.front().records.rows.cols() - block.latents - block.next_latents - 1;
        else if (block.rows.size() > 0)
            parameters = block.rows.cols() - block.latents - 1;
        if (block.link.rows() == 0 && block.linked_parts.empty()) continue;
        in_chain[b] = 1;
        if (block.next >= 0) in_chain[static_cast<std::size_t>(block.next)] = 1;
    }
    std::vector<BlockTriangle> blocks(rows.size());
    std::vector<double> value(pieces_of(rows.size()), 0.0);
    if (keep_rows) result.rows.resize(rows.size());
    result.linked_records.assign(rows.size(), 0);
    for_pieces(rows.size(), [&](std::size_t begin, std::size_t end, std::size_t piece) {
        for (std::size_t b = begin; b < end; ++b) {
            const BlockRows& block = rows[b];
            WhitenedRows<double> standard = standard_rows(block, laws, psi, curvature);
            value[piece] += standard.value;
            if (standard.rows.size() == 0) standard.rows.resize(0, block.latents + parameters + 1);
            const bool as_it_is = in_chain[b] != 0 && standard.rows.rows() <= standard.rows.cols();
            if (keep_rows && !as_it_is) result.rows[b] = standard;
            blocks[b] = in_chain[b] != 0 ? linked_block(std::move(standard.rows), block.latents)
                                         : block_triangle(std::move(standard.rows), block.latents);
            const Eigen::Index constraints = block.link.rows();
            if (constraints == 0 && block.linked_parts.empty()) continue;
            // Links that no longer hold (an interval on the wrong branch of a fold) are to be repaired. With the steps
            // of far outliers a section series with noise 5e-3 took 200 steps and more, guarded 29.
            WhitenedRows<double> linked = standard_rows(block.linked_parts, laws, psi,
                                                        curvature == Curvature::step ? Curvature::guarded : curvature);
            value[piece] += linked.value;
            result.linked_records[b] = linked.rows.rows();
            blocks[b].next = block.next;
            Eigen::MatrixXd& link = blocks[b].link;
            if (constraints == 0) {
                link = std::move(linked.rows);
                continue;
            }
            link.resize(constraints + linked.rows.rows(), block.link.cols());
            link.topRows(constraints) = block.link / matching;
            if (linked.rows.rows() > 0) link.bottomRows(linked.rows.rows()) = linked.rows;
        }
    });
    for (const double part : value)
        result.value += part;
    if (factorised)
        result.arrow = factorise(std::move(blocks), parameters);
    else
        result.arrow.blocks = std::move(blocks);
    return result;
}

}  // namespace orbid::estimator
