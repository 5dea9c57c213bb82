#include <algorithm>
#include <cmath>
#include <utility>

#include "estimator/algebra/block_arrow.hpp"
#include "estimator/algebra/block_arrow_parts.hpp"
#include "estimator/algebra/block_loop.hpp"
#include "models/arithmetic/orthogonal_factor.hpp"
#include "models/arithmetic/triangular_solve.hpp"

namespace orbid::estimator {

ReducedProblem condense(const BlockArrow& arrow, double mu) {
    const Eigen::Index width = arrow.parameters + 1;
    const auto width_of_chains = static_cast<Eigen::Index>(arrow.chains.size()) * width;
    ReducedProblem reduced_problem;
    const bool any_alone = std::find(arrow.linked.begin(), arrow.linked.end(), false) != arrow.linked.end();
    if (any_alone) reduced_problem.top.reserve(arrow.blocks.size());
    Eigen::Index damped_rows = 0;
    for (std::size_t b = 0; b < arrow.blocks.size() && mu > 0.0; ++b)
        if (!arrow.linked[b]) damped_rows += arrow.blocks[b].latents;
    Eigen::MatrixXd stacked(width + damped_rows + width_of_chains, width);
    stacked.topRows(width) = arrow.pool;
    Eigen::Index row = width;
    for (std::size_t b = 0; any_alone && b < arrow.blocks.size(); ++b) {
        const BlockTriangle& block = arrow.blocks[b];
        const Eigen::Index l = block.latents;
        if (l == 0 || arrow.linked[b]) {
            reduced_problem.top.emplace_back(0, l + width);
        } else if (mu > 0.0) {
            Eigen::MatrixXd damped = Eigen::MatrixXd::Zero(2 * l, l + width);
            damped.topRows(l) = block.triangle.topRows(l);
            damped.bottomLeftCorner(l, l).diagonal() = std::sqrt(mu) * block.norm;
            models::householder_in_place(damped);
            Eigen::MatrixXd factor = std::move(damped);
            factor.triangularView<Eigen::StrictlyLower>().setZero();
            reduced_problem.top.push_back(factor.topRows(l));
            stacked.middleRows(row, l) = factor.bottomRightCorner(l, width);
            row += l;
        } else {
            reduced_problem.top.push_back(block.triangle.topRows(l));
        }
    }
    reduced_problem.chains.reserve(arrow.chains.size());
    for (std::size_t i = 0; i < arrow.chains.size(); ++i) {
        if (mu > 0.0)
            reduced_problem.chains.push_back(
                std::make_shared<const ChainFactor>(factorise_chain(arrow, i, arrow.undamped[i]->cyclic, mu)));
        else
            reduced_problem.chains.push_back(arrow.undamped[i]);
        stacked.middleRows(row, width) = reduced_problem.chains.back()->rest;
        row += width;
    }
    Eigen::MatrixXd pool = row > width ? upper_triangle(stacked) : arrow.pool;
    reduced_problem.spread = arrow.spread;
    if (!arrow.spread.alone() && mu > 0.0) {
        reduced_problem.joins = join_chains(arrow, reduced_problem.chains, pool);
    } else if (!arrow.spread.alone()) {
        reduced_problem.joins = arrow.undamped_joins;
        pool = arrow.undamped_rest;
    }
    reduced_problem.r = pool.topLeftCorner(arrow.parameters, arrow.parameters);
    reduced_problem.rhs = pool.topRightCorner(arrow.parameters, 1);
    reduced_problem.rest = std::abs(pool(arrow.parameters, arrow.parameters));
    return reduced_problem;
}

std::vector<Eigen::VectorXd> latent_steps(const BlockArrow& arrow, const ReducedProblem& reduced_problem,
                                          const Eigen::VectorXd& d) {
    std::vector<Eigen::VectorXd> steps(arrow.blocks.size());
    for (std::size_t b = 0; b < arrow.blocks.size(); ++b) {
        const Eigen::Index l = arrow.blocks[b].latents;
        if (l == 0 || arrow.linked[b]) {
            steps[b].resize(0);
            continue;
        }
        const Eigen::MatrixXd& top = reduced_problem.top[b];
        steps[b] = -(top.rightCols(1) + top.middleCols(l, arrow.parameters) * d);
        models::solve_upper_in_place(top.leftCols(l), steps[b]);
    }
    if (reduced_problem.joins) {
        const std::vector<Eigen::MatrixXd> ends = reduced_problem.joins->solve(d);
        for (std::size_t k = 0; k < arrow.parts.size(); ++k) {
            const std::vector<std::size_t>& chain = arrow.chains[arrow.parts[k]];
            steps[chain.front()] = ends[k].col(0).head(arrow.blocks[chain.front()].latents);
            steps[chain.back()] = ends[k].col(0).tail(arrow.blocks[chain.back()].latents);
        }
    }
    for (const auto& chain : reduced_problem.chains)
        solve_chain(*chain, d, steps);
    return steps;
}

namespace {

/// Adds the change of one block. @param moved  room for its rows
void add_change(const BlockTriangle& block, const Eigen::VectorXd& d, const std::vector<Eigen::VectorXd>& d_z,
                std::size_t b, Eigen::VectorXd& moved, ModelChange& change) {
    const auto add = [&](const Eigen::MatrixXd& rows, const Eigen::VectorXd& own, const Eigen::VectorXd* next) {
        moved.setZero(rows.rows());
        Eigen::Index column = 0;
        const auto along = [&](const Eigen::VectorXd& x) {
            for (Eigen::Index j = 0; j < x.size(); ++j, ++column)
                for (Eigen::Index k = 0; k < rows.rows(); ++k)
                    moved[k] += rows(k, column) * x[j];
        };
        along(own);
        if (next != nullptr) along(*next);
        along(d);
        for (Eigen::Index k = 0; k < rows.rows(); ++k) {
            change.linear += moved[k] * rows(k, column);
            change.quadratic += moved[k] * moved[k];
        }
    };
    add(block.triangle, d_z[b], nullptr);
    if (block.link.rows() == 0) return;
    add(block.link, d_z[b], block.next >= 0 ? &d_z[static_cast<std::size_t>(block.next)] : nullptr);
}

}  // namespace

std::vector<double> model_changes(const BlockArrow& arrow, const Eigen::VectorXd& d,
                                  const std::vector<Eigen::VectorXd>& d_z) {
    std::vector<double> changes(arrow.blocks.size());
    for_blocks(changes.size(), [&](std::size_t b) {
        ModelChange change;
        Eigen::VectorXd moved;
        add_change(arrow.blocks[b], d, d_z, b, moved, change);
        changes[b] = change.linear + 0.5 * change.quadratic;
    });
    return changes;
}

ModelChange model_change(const BlockArrow& arrow, const Eigen::VectorXd& d, const std::vector<Eigen::VectorXd>& d_z) {
    std::vector<ModelChange> part(pieces_of(arrow.blocks.size()));
    for_pieces(arrow.blocks.size(), [&](std::size_t begin, std::size_t end, std::size_t piece) {
        Eigen::VectorXd moved;
        for (std::size_t b = begin; b < end; ++b)
            add_change(arrow.blocks[b], d, d_z, b, moved, part[piece]);
    });
    ModelChange sum;
    for (const ModelChange& change : part) {
        sum.linear += change.linear;
        sum.quadratic += change.quadratic;
    }
    return {arrow.spread.sum(sum.linear), arrow.spread.sum(sum.quadratic)};
}

Eigen::Index undetermined_states(const BlockArrow& arrow) {
    double count = 0.0;
    for (std::size_t b = 0; b < arrow.blocks.size(); ++b)
        if (arrow.spread.owns(b)) {
            const std::vector<bool>& dead = arrow.blocks[b].dead;
            count += static_cast<double>(std::count(dead.begin(), dead.end(), true));
        }
    return static_cast<Eigen::Index>(arrow.spread.sum(count));
}

double log_abs_determinant(const ReducedProblem& reduced_problem) {
    double sum = 0.0;
    for (const Eigen::MatrixXd& top : reduced_problem.top)
        if (top.rows() > 0) sum += top.diagonal().array().abs().log().sum();
    for (const auto& chain : reduced_problem.chains)
        sum += log_abs_determinant(*chain);
    if (reduced_problem.joins) sum += reduced_problem.joins->log_abs_determinant();
    return reduced_problem.spread.sum(sum);
}

void visit_covariance(const BlockArrow& arrow, const ReducedProblem& reduced_problem,
                      const Eigen::MatrixXd& parameter_covariance, const CovarianceUse& node,
                      const CovarianceUse& link) {
    const Eigen::Index r = parameter_covariance.rows();
    for_pieces(arrow.blocks.size(), [&](std::size_t begin, std::size_t end, std::size_t) {
        Eigen::MatrixXd p;
        for (std::size_t b = begin; b < end; ++b) {
            if (arrow.linked[b]) continue;
            const Eigen::Index l = arrow.blocks[b].latents;
            Eigen::MatrixXd inverse = Eigen::MatrixXd::Identity(l, l);
            models::solve_upper_in_place(reduced_problem.top[b].leftCols(l), inverse);
            const Eigen::MatrixXd gain = -inverse * reduced_problem.top[b].middleCols(l, r);
            p.resize(l + r, l + r);
            const Eigen::MatrixXd across = gain * parameter_covariance;
            const Eigen::MatrixXd own = inverse * inverse.transpose() + across * gain.transpose();
            p.topLeftCorner(l, l) = 0.5 * (own + own.transpose());
            p.topRightCorner(l, r) = across;
            p.bottomLeftCorner(r, l) = across.transpose();
            p.bottomRightCorner(r, r) = parameter_covariance;
            for (Eigen::Index j = 0; j < l; ++j) {
                if (!arrow.blocks[b].dead[static_cast<std::size_t>(j)]) continue;
                p.row(j).setZero();
                p.col(j).setZero();
            }
            node(b, p);
        }
    });
    std::vector<const Eigen::MatrixXd*> ends(reduced_problem.chains.size(), nullptr);
    std::vector<Eigen::MatrixXd> found;
    if (reduced_problem.joins) found = reduced_problem.joins->covariance(parameter_covariance);
    for (std::size_t k = 0; k < found.size(); ++k)
        ends[arrow.parts[k]] = &found[k];
    for (std::size_t i = 0; i < reduced_problem.chains.size(); ++i) {
        const ChainFactor& chain = *reduced_problem.chains[i];
        if (ends[i] != nullptr)
            part_covariance(chain, *ends[i], parameter_covariance, node, link);
        else
            chain_covariance(chain, parameter_covariance, node, link);
    }
}

Eigen::MatrixXd inverse_square(const Eigen::MatrixXd& triangle) {
    Eigen::MatrixXd inverse = Eigen::MatrixXd::Identity(triangle.rows(), triangle.rows());
    models::solve_upper_in_place(triangle, inverse);
    return inverse * inverse.transpose();
}

}  // namespace orbid::estimator
