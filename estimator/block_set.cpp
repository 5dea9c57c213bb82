#include "estimator/block_set.hpp"

#include <algorithm>
#include <cmath>
#include <stdexcept>

#include <Eigen/Cholesky>

namespace orbid::estimator {

namespace {

void check_value(const BlockValue& value, const ActiveBlock& block, const std::string& label, Eigen::Index parameters,
                 Eigen::Index next_latents, bool derivatives) {
    const auto records = static_cast<Eigen::Index>(block.channel.size());
    const auto shaped = [](const Eigen::MatrixXd& matrix, Eigen::Index rows, Eigen::Index columns) {
        return rows == 0 || columns == 0 || (matrix.rows() == rows && matrix.cols() == columns);
    };
    const bool fits = value.e.size() == records && (block.constraints == 0 || value.c.size() == block.constraints) &&
                      (!derivatives || (value.e_theta.rows() == records && value.e_theta.cols() == parameters &&
                                        shaped(value.e_z, records, block.latents) &&
                                        shaped(value.c_theta, block.constraints, parameters) &&
                                        shaped(value.c_z, block.constraints, block.latents) &&
                                        shaped(value.c_next, block.constraints, next_latents)));
    if (!fits)
        throw std::invalid_argument("residual block \"" + label + "\": values of the wrong shape; expected " +
                                    std::to_string(records) + " records, " + std::to_string(parameters) +
                                    " parameters, " + std::to_string(block.latents) + " latent states, " +
                                    std::to_string(block.constraints) + " constraints");
}

bool finite(const BlockValue& value, const ActiveBlock& block, bool derivatives) {
    if (!value.e.allFinite() || (block.constraints > 0 && !value.c.allFinite())) return false;
    if (!derivatives) return true;
    if (!value.e_theta.allFinite() || !value.e_z.allFinite()) return false;
    return block.constraints == 0 || (value.c_theta.allFinite() && value.c_z.allFinite() && value.c_next.allFinite());
}

/// Log-normal errors need a positive prediction.
bool predicted(const BlockValue& value, const ActiveBlock& block, const std::vector<ErrorLaw>& laws) {
    for (const LawPart& part : block.parts) {
        if (!std::holds_alternative<LogNormalErrors>(laws[part.law].distribution)) continue;
        for (std::size_t i = 0; i < part.records.size(); ++i)
            if (!(part.observed[static_cast<Eigen::Index>(i)] - value.e[part.records[i]] > 0.0)) return false;
    }
    return true;
}

/// Sorts the records of a block by law.
std::vector<LawPart> parts_of(const ActiveBlock& block, const BlockLayout& from, const std::vector<ErrorLaw>& laws,
                              const std::string& who) {
    std::vector<LawPart> parts;
    for (std::size_t l = 0; l < laws.size(); ++l) {
        const ErrorLaw& law = laws[l];
        LawPart part{l, {}, {}};
        std::size_t first = 0;
        for (const int channel : law.channels) {
            const std::size_t before = part.records.size();
            for (std::size_t i = 0; i < block.channel.size(); ++i)
                if (block.channel[i] == channel) part.records.push_back(static_cast<Eigen::Index>(i));
            const std::size_t own = part.records.size() - before;
            if (channel == law.channels.front()) first = own;
            if (own != first)
                throw std::invalid_argument(who +
                                            "the responses of a full covariance must have the same number of "
                                            "records, not " +
                                            std::to_string(first) + " and " + std::to_string(own));
        }
        if (part.records.empty()) continue;
        if (law.needs_observed()) {
            if (from.observed.size() != static_cast<Eigen::Index>(block.channel.size()))
                throw std::invalid_argument(who +
                                            "log-normal and relative errors need the observed value of every "
                                            "record");
            if (block.deviation.size() > 0)
                throw std::invalid_argument(who + "known sds do not go with log-normal or relative errors");
            part.observed.resize(static_cast<Eigen::Index>(part.records.size()));
            for (std::size_t i = 0; i < part.records.size(); ++i) {
                const double y = from.observed[part.records[i]];
                if (!std::isfinite(y) || (std::holds_alternative<LogNormalErrors>(law.distribution) && !(y > 0.0)))
                    throw std::invalid_argument(who + "observed value " + std::to_string(y) + " of record " +
                                                std::to_string(part.records[i]) +
                                                " must be finite, and positive for log-normal errors");
                part.observed[static_cast<Eigen::Index>(i)] = y;
            }
        }
        parts.push_back(std::move(part));
    }
    return parts;
}

}  // namespace

std::vector<Channel> channels_of(const std::vector<Residual*>& residuals) {
    std::vector<Channel> channels;
    for (std::size_t r = 0; r < residuals.size(); ++r)
        for (std::size_t g = 0; g < residuals[r]->groups().size(); ++g)
            channels.push_back({r, static_cast<int>(g)});
    return channels;
}

BlockSet freeze(const std::vector<Residual*>& residuals, const std::vector<Channel>& channels,
                const std::vector<ErrorLaw>& laws) {
    BlockSet set;
    set.count = Eigen::VectorXd::Zero(static_cast<Eigen::Index>(channels.size()));
    std::vector<const ErrorLaw*> law_of(channels.size(), nullptr);
    for (const ErrorLaw& law : laws)
        for (const int channel : law.channels)
            law_of[static_cast<std::size_t>(channel)] = &law;
    int first_channel = 0;
    for (std::size_t r = 0; r < residuals.size(); ++r) {
        const auto& layout = residuals[r]->layout();
        const auto groups = static_cast<int>(residuals[r]->groups().size());
        const LatentStructure structure = residuals[r]->structure();
        set.provisional = set.provisional || residuals[r]->provisional();
        const std::size_t first_block = set.blocks.size();
        std::vector<std::ptrdiff_t> place(layout.size(), -1);
        for (std::size_t b = 0; b < layout.size(); ++b) {
            const BlockLayout& from = layout[b];
            if (!from.active || (from.group.empty() && from.latents == 0)) continue;
            const std::string who = "residual block \"" + from.label + "\": ";
            ActiveBlock block;
            block.residual = r;
            block.block = b;
            block.latents = from.latents;
            const auto records = static_cast<Eigen::Index>(from.group.size());
            for (const int g : from.group) {
                if (g < 0 || g >= groups)
                    throw std::invalid_argument(who + "group " + std::to_string(g) + " does not exist, there are " +
                                                std::to_string(groups));
                block.channel.push_back(first_channel + g);
                set.count[first_channel + g] += 1.0;
            }
            if (structure == LatentStructure::none && (from.latents > 0 || from.constraints > 0))
                throw std::invalid_argument(who + "has latent states, but its residual says it has none");
            if (from.deviation.size() > 0) {
                if (from.deviation.size() != records || !(from.deviation.array() > 0.0).all() ||
                    !from.deviation.allFinite())
                    throw std::invalid_argument(who + "known sds must be positive and finite, one for each of the " +
                                                std::to_string(records) + " records");
                if (from.shape.size() > 0)
                    throw std::invalid_argument(who + "has both known sds and a covariance shape: give one of them");
                block.deviation = from.deviation;
                set.ln_det_shapes += 2.0 * from.deviation.array().log().sum();
            }
            if (from.shape.size() == 0) {
                block.parts = parts_of(block, from, laws, who);
            } else {
                if (from.shape.rows() != records || from.shape.cols() != records)
                    throw std::invalid_argument(who + "covariance shape must be " + std::to_string(records) + " x " +
                                                std::to_string(records));
                const Eigen::LLT<Eigen::MatrixXd> factor(from.shape);
                // A computed covariance is symmetric up to rounding.
                const double largest = from.shape.diagonal().cwiseAbs().maxCoeff();
                const bool symmetric = (from.shape - from.shape.transpose()).cwiseAbs().maxCoeff() <= 1e-12 * largest;
                if (factor.info() != Eigen::Success || !symmetric || !from.shape.allFinite())
                    throw std::invalid_argument(who + "covariance shape must be symmetric and positive definite");
                block.cholesky = factor.matrixL();
                set.ln_det_shapes += 2.0 * block.cholesky.diagonal().array().log().sum();
                for (const int c : block.channel) {
                    const ErrorLaw* law = law_of[static_cast<std::size_t>(c)];
                    if (law->joint() || !std::holds_alternative<NormalErrors>(law->distribution))
                        throw std::invalid_argument(who + "a covariance shape needs normal errors in all its groups");
                }
            }
            if (from.constraints > 0) {
                block.constraints = from.constraints;
                block.next = from.next;
                block.constraint_size = from.constraint_size;
                if (block.constraint_size.size() == 0) block.constraint_size = Eigen::VectorXd::Ones(from.constraints);
                if (block.constraint_size.size() != from.constraints || !(block.constraint_size.array() > 0.0).all())
                    throw std::invalid_argument(who + "constraint sizes must be positive, one for each of the " +
                                                std::to_string(from.constraints) + " constraints");
                if (from.next >= static_cast<std::ptrdiff_t>(layout.size()))
                    throw std::invalid_argument(who + "its next block " + std::to_string(from.next) +
                                                " does not exist, there are " + std::to_string(layout.size()));
            }
            set.records += records;
            set.latents += from.latents;
            place[b] = static_cast<std::ptrdiff_t>(set.blocks.size());
            set.blocks.push_back(std::move(block));
        }
        for (std::size_t a = first_block; a < set.blocks.size(); ++a) {
            ActiveBlock& block = set.blocks[a];
            if (block.next >= 0) {
                block.next = place[static_cast<std::size_t>(block.next)];
                if (block.next < 0) block.constraints = 0;
            }
            set.constraints += block.constraints;
        }
        first_channel += groups;
    }
    return set;
}

Evaluation evaluate(const std::vector<Residual*>& residuals, const BlockSet& set, const std::vector<ErrorLaw>& laws,
                    const Eigen::VectorXd& theta, const Latents& latents, bool derivatives) {
    std::vector<std::vector<BlockValue>> answers(residuals.size());
    for (std::size_t r = 0; r < residuals.size(); ++r) {
        answers[r] = residuals[r]->evaluate(theta, latents[r], derivatives);
        if (answers[r].size() != residuals[r]->layout().size())
            throw std::invalid_argument("residual \"" + std::string(residuals[r]->type()) + "\": answered " +
                                        std::to_string(answers[r].size()) + " blocks, layout has " +
                                        std::to_string(residuals[r]->layout().size()));
    }
    Evaluation evaluation;
    evaluation.values.reserve(set.blocks.size());
    for (std::size_t a = 0; a < set.blocks.size(); ++a) {
        const ActiveBlock& block = set.blocks[a];
        BlockValue& value = answers[block.residual][block.block];
        if (value.status == BlockStatus::ok) {
            const Eigen::Index next_latents =
                block.next >= 0 ? set.blocks[static_cast<std::size_t>(block.next)].latents : 0;
            check_value(value, block, residuals[block.residual]->layout()[block.block].label, theta.size(),
                        next_latents, derivatives);
            if (!finite(value, block, derivatives) || !predicted(value, block, laws))
                value.status = BlockStatus::failed;
        }
        if (value.status != BlockStatus::ok) evaluation.failed.push_back(a);
        evaluation.values.push_back(std::move(value));
    }
    return evaluation;
}

Eigen::VectorXd law_errors(const ActiveBlock& block, const LawPart& part, const ErrorLaw& law,
                           const Eigen::VectorXd& e) {
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

double value_change(const BlockSet& set, const std::vector<ErrorLaw>& laws, const Eigen::VectorXd& psi,
                    const std::vector<BlockValue>& from, const std::vector<BlockValue>& to) {
    double change = 0.0;
    Eigen::VectorXd scale;
    for (std::size_t b = 0; b < set.blocks.size(); ++b) {
        const ActiveBlock& block = set.blocks[b];
        for (const LawPart& part : block.parts) {
            const ErrorLaw& law = laws[part.law];
            change +=
                value_change(law, law_errors(block, part, law, from[b].e), law_errors(block, part, law, to[b].e),
                             part.observed, psi.segment(law.first, static_cast<Eigen::Index>(law.coordinates.size())));
        }
        if (block.cholesky.size() == 0) continue;
        if (scale.size() == 0) scale = scales_of(laws, psi);
        Eigen::MatrixXd pair(from[b].e.size(), 2);
        pair << to[b].e - from[b].e, to[b].e + from[b].e;
        whiten(block.channel, block.cholesky, scale, pair);
        change += 0.5 * pair.col(0).dot(pair.col(1));
    }
    return change;
}

double violation_change(const BlockSet& set, const std::vector<BlockValue>& from, const std::vector<BlockValue>& to) {
    double change = 0.0;
    for (std::size_t b = 0; b < set.blocks.size(); ++b) {
        if (set.blocks[b].constraints == 0) continue;
        const Eigen::VectorXd inverse = set.blocks[b].constraint_size.cwiseInverse();
        change += 0.5 * (to[b].c - from[b].c).cwiseProduct(inverse).dot((to[b].c + from[b].c).cwiseProduct(inverse));
    }
    return change;
}

Violation violation(const BlockSet& set, const std::vector<BlockValue>& values) {
    Violation result;
    double square = 0.0;
    for (std::size_t b = 0; b < set.blocks.size(); ++b) {
        if (set.blocks[b].constraints == 0) continue;
        const Eigen::VectorXd c = values[b].c.cwiseQuotient(set.blocks[b].constraint_size);
        result.largest = std::max(result.largest, c.lpNorm<Eigen::Infinity>());
        square += c.squaredNorm();
    }
    if (set.constraints > 0) result.rms = std::sqrt(square / static_cast<double>(set.constraints));
    return result;
}

Eigen::VectorXd scales_of(const std::vector<ErrorLaw>& laws, const Eigen::VectorXd& psi) {
    Eigen::Index channels = 0;
    for (const ErrorLaw& law : laws)
        channels += static_cast<Eigen::Index>(law.channels.size());
    Eigen::VectorXd scale(channels);
    for (const ErrorLaw& law : laws)
        for (std::size_t i = 0; i < law.channels.size(); ++i)
            scale[law.channels[i]] =
                law.scale(psi.segment(law.first, static_cast<Eigen::Index>(law.coordinates.size())), i);
    return scale;
}

void whiten(const std::vector<int>& channel, const Eigen::MatrixXd& cholesky, const Eigen::VectorXd& scale,
            Eigen::MatrixXd& rows) {
    for (Eigen::Index i = 0; i < rows.rows(); ++i)
        rows.row(i) /= scale[channel[static_cast<std::size_t>(i)]];
    if (cholesky.size() > 0) cholesky.triangularView<Eigen::Lower>().solveInPlace(rows);
}

}  // namespace orbid::estimator
