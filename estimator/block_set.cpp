#include "estimator/block_set.hpp"

#include <cmath>
#include <stdexcept>

#include <Eigen/Cholesky>

namespace orbid::estimator {

namespace {

void check_value(const BlockValue& value, const ActiveBlock& block, const std::string& label, Eigen::Index parameters,
                 bool derivatives) {
    const auto records = static_cast<Eigen::Index>(block.channel.size());
    const bool fits =
        value.e.size() == records &&
        (!derivatives || (value.e_theta.rows() == records && value.e_theta.cols() == parameters &&
                          (block.latents == 0 || (value.e_z.rows() == records && value.e_z.cols() == block.latents))));
    if (!fits)
        throw std::invalid_argument("residual block \"" + label + "\": values of the wrong shape; expected " +
                                    std::to_string(records) + " records, " + std::to_string(parameters) +
                                    " parameters, " + std::to_string(block.latents) + " latent states");
}

bool finite(const BlockValue& value, bool derivatives) {
    return value.e.allFinite() && (!derivatives || (value.e_theta.allFinite() && value.e_z.allFinite()));
}

}  // namespace

std::vector<Channel> channels_of(const std::vector<Residual*>& residuals) {
    std::vector<Channel> channels;
    for (std::size_t r = 0; r < residuals.size(); ++r)
        for (std::size_t g = 0; g < residuals[r]->groups().size(); ++g)
            channels.push_back({r, static_cast<int>(g)});
    return channels;
}

BlockSet freeze(const std::vector<Residual*>& residuals, const std::vector<Channel>& channels) {
    BlockSet set;
    const auto size = static_cast<Eigen::Index>(channels.size());
    set.count = Eigen::VectorXd::Zero(size);
    set.information = Eigen::MatrixXd::Zero(size, size);
    int first_channel = 0;
    for (std::size_t r = 0; r < residuals.size(); ++r) {
        const auto& layout = residuals[r]->layout();
        const auto groups = static_cast<int>(residuals[r]->groups().size());
        for (std::size_t b = 0; b < layout.size(); ++b) {
            const BlockLayout& from = layout[b];
            if (!from.active || from.group.empty()) continue;
            ActiveBlock block{r, b, {}, from.latents, {}};
            const auto records = static_cast<Eigen::Index>(from.group.size());
            for (const int g : from.group) {
                if (g < 0 || g >= groups)
                    throw std::invalid_argument("residual block \"" + from.label + "\": group " + std::to_string(g) +
                                                " does not exist, there are " + std::to_string(groups));
                block.channel.push_back(first_channel + g);
                set.count[first_channel + g] += 1.0;
            }
            if (from.latents > 0 && residuals[r]->structure() == LatentStructure::none)
                throw std::invalid_argument("residual block \"" + from.label +
                                            "\": has latent states, but its residual says it has none");
            if (from.shape.size() == 0) {
                for (const int c : block.channel)
                    set.information(c, c) += 2.0;
            } else {
                if (from.shape.rows() != records || from.shape.cols() != records)
                    throw std::invalid_argument("residual block \"" + from.label + "\": covariance shape must be " +
                                                std::to_string(records) + " x " + std::to_string(records));
                const Eigen::LLT<Eigen::MatrixXd> factor(from.shape);
                if (factor.info() != Eigen::Success || !from.shape.allFinite())
                    throw std::invalid_argument("residual block \"" + from.label +
                                                "\": covariance shape must be symmetric and positive definite");
                block.cholesky = factor.matrixL();
                set.ln_det_shapes += 2.0 * block.cholesky.diagonal().array().log().sum();
                const Eigen::MatrixXd inverse = factor.solve(Eigen::MatrixXd::Identity(records, records));
                for (Eigen::Index i = 0; i < records; ++i) {
                    const int g = block.channel[static_cast<std::size_t>(i)];
                    set.information(g, g) += 1.0;
                    for (Eigen::Index j = 0; j < records; ++j)
                        set.information(g, block.channel[static_cast<std::size_t>(j)]) +=
                            from.shape(i, j) * inverse(i, j);
                }
            }
            set.records += records;
            set.latents += from.latents;
            set.blocks.push_back(std::move(block));
        }
        first_channel += groups;
    }
    return set;
}

Evaluation evaluate(const std::vector<Residual*>& residuals, const BlockSet& set, const Eigen::VectorXd& theta,
                    const Latents& latents, bool derivatives) {
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
            check_value(value, block, residuals[block.residual]->layout()[block.block].label, theta.size(),
                        derivatives);
            if (!finite(value, derivatives)) value.status = BlockStatus::failed;
        }
        if (value.status != BlockStatus::ok) evaluation.failed.push_back(a);
        evaluation.values.push_back(std::move(value));
    }
    return evaluation;
}

void whiten(const std::vector<int>& channel, const Eigen::MatrixXd& cholesky, const Eigen::VectorXd& scale,
            Eigen::MatrixXd& rows) {
    for (Eigen::Index i = 0; i < rows.rows(); ++i)
        rows.row(i) /= scale[channel[static_cast<std::size_t>(i)]];
    if (cholesky.size() > 0) cholesky.triangularView<Eigen::Lower>().solveInPlace(rows);
}

}  // namespace orbid::estimator
