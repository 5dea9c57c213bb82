#include "estimator/problem/block_set.hpp"

#include <algorithm>
#include <cmath>
#include <map>
#include <numeric>
#include <stdexcept>

#include "estimator/algebra/block_loop.hpp"
#include "models/arithmetic/triangular_solve.hpp"
#include "models/system/stopped.hpp"

namespace orbid::estimator {

namespace {

void check_value(const BlockValue& value, const ActiveBlock& block, const std::string& label, Eigen::Index parameters,
                 Eigen::Index next_latents, bool derivatives) {
    const auto records = static_cast<Eigen::Index>(block.channel().size());
    const auto shaped = [](const Eigen::MatrixXd& matrix, Eigen::Index rows, Eigen::Index columns) {
        return rows == 0 || columns == 0 || (matrix.rows() == rows && matrix.cols() == columns);
    };
    const bool fits = value.e.size() == records && (block.constraints == 0 || value.c.size() == block.constraints) &&
                      (!derivatives || (value.e_theta.rows() == records && value.e_theta.cols() == parameters &&
                                        shaped(value.e_z, records, block.latents) &&
                                        (block.linked_parts().empty() || shaped(value.e_next, records, next_latents)) &&
                                        shaped(value.c_theta, block.constraints, parameters) &&
                                        shaped(value.c_z, block.constraints, block.latents) &&
                                        shaped(value.c_next, block.constraints, next_latents)));
    if (!fits)
        throw std::invalid_argument("residual block \"" + label + "\": values of the wrong shape; expected " +
                                    std::to_string(records) + " records, " + std::to_string(parameters) +
                                    " parameters, " + std::to_string(block.latents) + " latent states, " +
                                    std::to_string(block.constraints) + " constraints");
}

/// x - x is 0 or nan, and sums of many are computed several at a time.
template <class Matrix>
bool all_finite(const Matrix& x) {
    return (x - x).sum() == 0.0;
}

bool finite(const BlockValue& value, const ActiveBlock& block, bool derivatives) {
    if (!all_finite(value.e) || (block.constraints > 0 && !all_finite(value.c))) return false;
    if (!derivatives) return true;
    if (!all_finite(value.e_theta) || !all_finite(value.e_z)) return false;
    if (!block.linked_parts().empty() && !all_finite(value.e_next)) return false;
    return block.constraints == 0 || (all_finite(value.c_theta) && all_finite(value.c_z) && all_finite(value.c_next));
}

/// Log-normal errors need a positive prediction.
bool predicted(const BlockValue& value, const ActiveBlock& block, const std::vector<NoiseModel>& laws) {
    const auto positive = [&](const LawPart& part) {
        if (!std::holds_alternative<LogNormalErrors>(laws[part.law].distribution)) return true;
        for (std::size_t i = 0; i < part.records.size(); ++i)
            if (!(part.observed[static_cast<Eigen::Index>(i)] - value.e[part.records[i]] > 0.0)) return false;
        return true;
    };
    return std::all_of(block.parts().begin(), block.parts().end(), positive) &&
           std::all_of(block.linked_parts().begin(), block.linked_parts().end(), positive);
}

}  // namespace

bool half_of_a_residual(const BlockSet& set, const std::vector<std::size_t>& blocks) {
    if (blocks.empty()) return false;
    std::map<std::size_t, std::size_t> active;
    std::map<std::size_t, std::size_t> chosen;
    for (const ActiveBlock& block : set.blocks)
        ++active[block.residual];
    for (const std::size_t b : blocks)
        ++chosen[set.blocks[b].residual];
    return std::any_of(chosen.begin(), chosen.end(),
                       [&](const auto& own) { return 2 * own.second >= active[own.first]; });
}

namespace {

/// The blocks of this rank.
Evaluation evaluate_here(const std::vector<const Residual*>& residuals, const BlockSet& set,
                         const std::vector<NoiseModel>& laws, const Eigen::VectorXd& theta, const Latents& latents,
                         bool derivatives) {
    std::vector<std::vector<BlockValue>> answers(residuals.size());
    for (std::size_t r = 0; r < residuals.size(); ++r) {
        answers[r] = residuals[r]->evaluate(set.active[r], theta, latents[r], derivatives);
        if (answers[r].size() != set.active[r].layout.size())
            throw std::invalid_argument("residual \"" + std::string(residuals[r]->type()) + "\": answered " +
                                        std::to_string(answers[r].size()) + " blocks, layout has " +
                                        std::to_string(set.active[r].layout.size()));
    }
    Evaluation evaluation;
    // Blocks have the order of their residual's: all answers of a single one are taken as they are.
    const bool all = answers.size() == 1 && answers.front().size() == set.blocks.size();
    if (all) evaluation.values = std::move(answers.front());
    evaluation.values.resize(set.blocks.size());
    for (std::size_t a = 0; a < set.blocks.size(); ++a) {
        const ActiveBlock& block = set.blocks[a];
        BlockValue& value = evaluation.values[a];
        if (!all) value = std::move(answers[block.residual][block.block]);
        if (value.status == BlockStatus::ok) {
            const Eigen::Index next_latents =
                block.next >= 0 ? set.blocks[static_cast<std::size_t>(block.next)].latents : 0;
            check_value(value, block, label_of(set, block), theta.size(), next_latents, derivatives);
            if (!finite(value, block, derivatives) || !predicted(value, block, laws))
                value.status = BlockStatus::failed;
        }
        if (value.status != BlockStatus::ok) evaluation.failed.push_back(a);
    }
    return evaluation;
}

}  // namespace

Evaluation evaluate(const std::vector<const Residual*>& residuals, const BlockSet& set,
                    const std::vector<NoiseModel>& laws, const Eigen::VectorXd& theta, const Latents& latents,
                    bool derivatives) {
    Evaluation evaluation = evaluate_here(residuals, set, laws, theta, latents, derivatives);
    evaluation.any_failed = set.spread.any(!evaluation.failed.empty());
    return evaluation;
}

Evaluation evaluate_trial(const std::vector<const Residual*>& residuals, const BlockSet& set,
                          const std::vector<NoiseModel>& laws, const Eigen::VectorXd& theta, const Latents& latents,
                          bool derivatives) {
    Evaluation evaluation;
    try {
        evaluation = evaluate_here(residuals, set, laws, theta, latents, derivatives);
    } catch (const models::Stopped&) {
        evaluation.values.resize(set.blocks.size());
        evaluation.failed.resize(set.blocks.size());
        std::iota(evaluation.failed.begin(), evaluation.failed.end(), std::size_t{0});
    }
    evaluation.any_failed = set.spread.any(!evaluation.failed.empty());
    return evaluation;
}

BlockErrors::BlockErrors(const std::vector<BlockValue>& values) {
    begin_.reserve(2 * values.size() + 1);
    begin_.push_back(0);
    for (const BlockValue& value : values)
        for (const Eigen::VectorXd* part : {&value.e, &value.c})
            begin_.push_back(begin_.back() + static_cast<std::size_t>(part->size()));
    values_.resize(begin_.back());
    for_blocks(values.size(), [&](std::size_t b) {
        std::copy_n(values[b].e.data(), values[b].e.size(), values_.data() + begin_[2 * b]);
        std::copy_n(values[b].c.data(), values[b].c.size(), values_.data() + begin_[2 * b + 1]);
    });
}

Eigen::VectorXd law_errors(const ActiveBlock& block, const LawPart& part, const NoiseModel& law,
                           const Eigen::Ref<const Eigen::VectorXd>& e) {
    Eigen::VectorXd errors(static_cast<Eigen::Index>(part.records.size()));
    const bool logarithmic = std::holds_alternative<LogNormalErrors>(law.distribution);
    for (std::size_t i = 0; i < part.records.size(); ++i) {
        const auto k = static_cast<Eigen::Index>(i);
        errors[k] = e[part.records[i]];
        if (logarithmic)
            errors[k] = -std::log1p(-errors[k] / part.observed[k]);
        else if (block.deviation.size() > 0)
            errors[k] /= block.deviation[part.records[i]];
    }
    return errors;
}

namespace {

/// Change of one law's records; of sums of squares without intermediate vectors, for blocks of long chains are short.
double part_change(const ActiveBlock& block, const LawPart& part, const NoiseModel& law, const Eigen::VectorXd& psi,
                   const Eigen::Ref<const Eigen::VectorXd>& from, const Eigen::Ref<const Eigen::VectorXd>& to) {
    if (law.joint() || !std::holds_alternative<NormalErrors>(law.distribution))
        return value_change(law, law_errors(block, part, law, from), law_errors(block, part, law, to), part.observed,
                            law.own(psi));
    double sum = 0.0;
    for (const Eigen::Index i : part.records) {
        const double unit = block.deviation.size() > 0 ? 1.0 / block.deviation[i] : 1.0;
        sum += (to[i] - from[i]) * unit * ((to[i] + from[i]) * unit);
    }
    return 0.5 * sum * std::exp(-2.0 * psi[law.first]);
}

/// Change of one block.
double block_change(const BlockSet& set, std::size_t b, const std::vector<NoiseModel>& laws, const Eigen::VectorXd& psi,
                    const Eigen::VectorXd& scale, const BlockErrors& from, const BlockErrors& to) {
    const ActiveBlock& block = set.blocks[b];
    double change = 0.0;
    for (const std::vector<LawPart>* parts : {&block.parts(), &block.linked_parts()})
        for (const LawPart& part : *parts)
            change += part_change(block, part, laws[part.law], psi, from.e(b), to.e(b));
    if (block.cholesky.size() == 0) return change;
    Eigen::MatrixXd pair(from.e(b).size(), 2);
    pair << to.e(b) - from.e(b), to.e(b) + from.e(b);
    whiten(block.channel(), block.cholesky, scale, pair);
    return change + 0.5 * pair.col(0).dot(pair.col(1));
}

}  // namespace

std::vector<double> value_changes(const BlockSet& set, const std::vector<NoiseModel>& laws, const Eigen::VectorXd& psi,
                                  const BlockErrors& from, const BlockErrors& to) {
    const Eigen::VectorXd scale = scales_of(laws, psi);
    std::vector<double> change(set.blocks.size());
    for_blocks(change.size(), [&](std::size_t b) { change[b] = block_change(set, b, laws, psi, scale, from, to); });
    return change;
}

double value_change(const BlockSet& set, const std::vector<NoiseModel>& laws, const Eigen::VectorXd& psi,
                    const BlockErrors& from, const BlockErrors& to) {
    const Eigen::VectorXd scale = scales_of(laws, psi);
    std::vector<double> change(pieces_of(set.blocks.size()), 0.0);
    for_pieces(set.blocks.size(), [&](std::size_t begin, std::size_t end, std::size_t piece) {
        for (std::size_t b = begin; b < end; ++b)
            change[piece] += block_change(set, b, laws, psi, scale, from, to);
    });
    double sum = 0.0;
    for (const double part : change)
        sum += part;
    return set.spread.sum(sum);
}

double violation_change(const BlockSet& set, const BlockErrors& from, const BlockErrors& to) {
    double change = 0.0;
    for (std::size_t b = 0; b < set.blocks.size(); ++b) {
        if (set.blocks[b].constraints == 0) continue;
        const Eigen::VectorXd inverse = set.blocks[b].constraint_size.cwiseInverse();
        change += 0.5 * (to.c(b) - from.c(b)).cwiseProduct(inverse).dot((to.c(b) + from.c(b)).cwiseProduct(inverse));
    }
    return set.spread.sum(change);
}

double violation(const BlockSet& set, const BlockErrors& errors) {
    double square = 0.0;
    for (std::size_t b = 0; b < set.blocks.size(); ++b) {
        if (set.blocks[b].constraints == 0) continue;
        const Eigen::VectorXd c = errors.c(b).cwiseQuotient(set.blocks[b].constraint_size);
        square += c.squaredNorm();
    }
    if (set.constraints == 0) return 0.0;
    return std::sqrt(set.spread.sum(square) / static_cast<double>(set.constraints));
}

Eigen::VectorXd scales_of(const std::vector<NoiseModel>& laws, const Eigen::VectorXd& psi) {
    Eigen::Index channels = 0;
    for (const NoiseModel& law : laws)
        channels += static_cast<Eigen::Index>(law.channels.size());
    Eigen::VectorXd scale(channels);
    for (const NoiseModel& law : laws)
        for (std::size_t i = 0; i < law.channels.size(); ++i)
            scale[law.channels[i]] = law.scale(law.own(psi), i);
    return scale;
}

void whiten(const std::vector<int>& channel, const Eigen::MatrixXd& cholesky, const Eigen::VectorXd& scale,
            Eigen::MatrixXd& rows) {
    for (Eigen::Index i = 0; i < rows.rows(); ++i)
        rows.row(i) /= scale[channel[static_cast<std::size_t>(i)]];
    if (cholesky.size() > 0) models::solve_lower_in_place(cholesky, rows);
}

}  // namespace orbid::estimator
