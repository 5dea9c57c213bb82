#include <algorithm>
#include <cmath>
#include <stdexcept>

#include <fmt/format.h>

#include "apps/estimation/posterior_stage.hpp"
#include "estimator/errors/noise_model.hpp"
#include "models/arithmetic/cholesky_factor.hpp"

namespace orbid::apps {

namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;
using estimator::NoiseModel;

/// The error parameters of a law at the estimate, in their coordinates.
VectorXd error_parameters(const NoiseModel& law, const std::vector<std::string>& names,
                          const estimator::Estimate& estimate) {
    VectorXd psi(static_cast<Index>(law.coordinates.size()));
    const auto scale_of = [&](int channel) -> const estimator::EstimatedScale& {
        for (const auto& scale : estimate.scales)
            if (scale.group == names[static_cast<std::size_t>(channel)]) return scale;
        throw std::logic_error("an error law without a scale in the estimate");
    };
    if (law.joint()) {
        for (const auto& covariance : estimate.covariances) {
            if (covariance.groups.front() != names[static_cast<std::size_t>(law.channels.front())]) continue;
            const MatrixXd triangle = models::CholeskyFactor(covariance.value).lower();
            Index k = 0;
            for (Index j = 0; j < triangle.cols(); ++j) {
                for (Index i = j; i < triangle.rows(); ++i, ++k)
                    psi[k] = law.coordinates[static_cast<std::size_t>(k)].at(triangle(i, j));
            }
        }
        return psi;
    }
    const auto& scale = scale_of(law.channels.front());
    for (std::size_t k = 0; k < law.coordinates.size(); ++k) {
        const auto& coordinate = law.coordinates[k];
        double value = coordinate.name == "scale" ? scale.value : coordinate.start;
        for (const auto& parameter : scale.shape)
            if (parameter.name == coordinate.name) value = parameter.value;
        psi[static_cast<Index>(k)] = coordinate.at(value);
    }
    return psi;
}

/// Whitened residuals of one group, block after block.
struct Collected {
    std::vector<double> values;
    std::vector<Index> sequences;
    std::vector<std::string> labels;  ///< of the block of each sequence
};

/// Positions of a group's records in a block.
std::vector<Index> records_of(const estimator::BlockLayout& block, int group) {
    std::vector<Index> records;
    for (std::size_t r = 0; r < block.group.size(); ++r)
        if (block.group[r] == group) records.push_back(static_cast<Index>(r));
    return records;
}

void collect(const VectorXd& values, const std::string& label, Collected& group) {
    if (values.size() == 0) return;
    group.values.insert(group.values.end(), values.data(), values.data() + values.size());
    group.sequences.push_back(values.size());
    group.labels.push_back(label);
}

}  // namespace

std::vector<GroupDiagnostic> diagnose_residuals(const std::vector<estimator::Residual*>& residuals,
                                                const estimator::Estimate& estimate) {
    std::vector<std::string> names;
    std::vector<const estimator::Group*> groups;
    std::vector<int> first;
    for (const estimator::Residual* residual : residuals) {
        first.push_back(static_cast<int>(names.size()));
        for (const estimator::Group& group : residual->groups()) {
            names.push_back(group.name);
            groups.push_back(&group);
        }
    }
    std::vector<Collected> collected(names.size());
    const auto laws = estimator::error_laws(residuals);
    Index latents = 0;
    for (std::size_t i = 0; i < residuals.size(); ++i) {
        const auto& layout = residuals[i]->layout();
        for (std::size_t b = 0; b < layout.size(); ++b) {
            const VectorXd& all = estimate.residuals[i][b].e;
            if (all.size() == 0) continue;
            latents += layout[b].latents;
            if (layout[b].shape.size() > 0) {
                // Normal errors that are linked by a known covariance: each record given those before it.
                VectorXd e = all;
                for (Index r = 0; r < e.size(); ++r) {
                    const auto channel =
                        static_cast<std::size_t>(first[i] + layout[b].group[static_cast<std::size_t>(r)]);
                    for (const auto& scale : estimate.scales)
                        if (scale.group == names[channel]) e[r] /= scale.value;
                }
                models::CholeskyFactor(layout[b].shape).solve_lower_in_place(e);
                for (std::size_t g = 0; g < residuals[i]->groups().size(); ++g)
                    collect(e(records_of(layout[b], static_cast<int>(g))), layout[b].label,
                            collected[static_cast<std::size_t>(first[i]) + g]);
                continue;
            }
            for (const NoiseModel& law : laws) {
                std::vector<Index> records;
                std::vector<Index> counts;
                for (const int channel : law.channels) {
                    const auto own = records_of(layout[b], channel - first[i]);
                    const bool here =
                        channel >= first[i] && channel < first[i] + static_cast<int>(residuals[i]->groups().size());
                    counts.push_back(here ? static_cast<Index>(own.size()) : 0);
                    if (here) records.insert(records.end(), own.begin(), own.end());
                }
                if (records.empty()) continue;
                VectorXd e = all(records);
                if (layout[b].deviation.size() > 0) e.array() /= layout[b].deviation(records).array();
                const VectorXd observed = law.needs_observed() ? VectorXd(layout[b].observed(records)) : VectorXd();
                const VectorXd standard =
                    estimator::standard_errors(law, e, observed, error_parameters(law, names, estimate));
                Index at = 0;
                for (std::size_t k = 0; k < law.channels.size(); ++k) {
                    collect(standard.segment(at, counts[k]), layout[b].label,
                            collected[static_cast<std::size_t>(law.channels[k])]);
                    at += counts[k];
                }
            }
        }
    }
    Index total = 0;
    for (const Collected& group : collected)
        total += static_cast<Index>(group.values.size());
    std::vector<GroupDiagnostic> result;
    for (std::size_t g = 0; g < collected.size(); ++g) {
        const Collected& group = collected[g];
        const VectorXd values = Eigen::Map<const VectorXd>(group.values.data(), std::ssize(group.values));
        // One record says nothing about a distribution; what is not finite was not evaluated.
        if (values.size() < 2 || !values.allFinite()) continue;
        estimator::ResidualSample sample;
        sample.residual = values;
        if (groups[g]->ordered) sample.sequences = group.sequences;
        // Each group determines its share of the unknowns.
        const auto unknowns = static_cast<double>(std::ssize(estimate.parameters) + latents);
        const double share = unknowns * static_cast<double>(values.size()) / static_cast<double>(total);
        sample.fitted = std::min(share, 0.5 * static_cast<double>(values.size()));
        sample.scale_estimated = groups[g]->scale.estimate;
        GroupDiagnostic entry{names[g], estimator::diagnose(sample), {}};
        for (const estimator::Outlier& outlier : entry.diagnostic.outliers) {
            Index record = outlier.record;
            std::size_t sequence = 0;
            while (record >= group.sequences[sequence])
                record -= group.sequences[sequence++];
            entry.outliers.push_back({group.labels[sequence], record, outlier.studentised, outlier.p});
        }
        result.push_back(std::move(entry));
    }
    return result;
}

}  // namespace orbid::apps
