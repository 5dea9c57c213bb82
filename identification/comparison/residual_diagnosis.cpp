#include <algorithm>
#include <stdexcept>

#include "estimator/errors/noise_model.hpp"
#include "identification/comparison/residual_diagnosis.hpp"
#include "identification/problem/estimated_values.hpp"
#include "models/arithmetic/cholesky_factor.hpp"

namespace orbid::identification {

namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;
using estimator::NoiseModel;

/// The error parameters of a law at the estimate, in their coordinates.
VectorXd error_parameters(const NoiseModel& law, const std::vector<std::string>& names,
                          const estimator::Estimate& estimate) {
    VectorXd psi(static_cast<Index>(law.coordinates.size()));
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
    const auto* scale = scale_of(estimate, names[static_cast<std::size_t>(law.channels.front())]);
    if (scale == nullptr) throw std::logic_error("an error law without a scale in the estimate");
    for (std::size_t k = 0; k < law.coordinates.size(); ++k) {
        const auto& coordinate = law.coordinates[k];
        double value = coordinate.name == "scale" ? scale->value : coordinate.start;
        for (const auto& parameter : scale->shape)
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

    void add(const VectorXd& block, const std::string& label) {
        if (block.size() == 0) return;
        values.insert(values.end(), block.data(), block.data() + block.size());
        sequences.push_back(block.size());
        labels.push_back(label);
    }
};

/// Positions of a group's records in a block.
std::vector<Index> records_of(const estimator::BlockLayout& block, int group) {
    std::vector<Index> records;
    for (std::size_t r = 0; r < block.group.size(); ++r)
        if (block.group[r] == group) records.push_back(static_cast<Index>(r));
    return records;
}

/// The residuals of an estimate by group; groups of all residuals have one numbering.
class WhitenedGroups {
public:
    WhitenedGroups(const std::vector<const estimator::Residual*>& residuals, const estimator::Estimate& estimate)
        : estimate_(estimate), laws_(estimator::error_laws(residuals, estimate.active)) {
        for (const estimator::ActiveSet& active : estimate.active) {
            first_.push_back(static_cast<int>(names_.size()));
            for (const estimator::Group& group : active.groups) {
                names_.push_back(group.name);
                groups_.push_back(&group);
            }
        }
        first_.push_back(static_cast<int>(names_.size()));
        collected_.resize(names_.size());
        for (std::size_t i = 0; i < residuals.size(); ++i) {
            const auto& layout = estimate.active[i].layout;
            for (std::size_t b = 0; b < layout.size(); ++b) {
                const VectorXd& e = estimate.residuals[i][b].e;
                if (e.size() == 0) continue;
                latents_ += layout[b].latents;
                if (layout[b].shape.size() > 0) {
                    add_linked(i, layout[b], e);
                } else {
                    for (const NoiseModel& law : laws_)
                        add_by_law(law, i, layout[b], e);
                }
            }
        }
    }

    /// Of the groups that can be examined.
    [[nodiscard]] std::vector<GroupDiagnostic> diagnostics() const {
        Index total = 0;
        for (const Collected& group : collected_)
            total += static_cast<Index>(group.values.size());
        std::vector<GroupDiagnostic> result;
        for (std::size_t g = 0; g < collected_.size(); ++g) {
            const Collected& group = collected_[g];
            const VectorXd values = Eigen::Map<const VectorXd>(group.values.data(), std::ssize(group.values));
            // One record says nothing about a distribution; what is not finite was not evaluated.
            if (values.size() < 2 || !values.allFinite()) continue;
            estimator::ResidualSample sample;
            sample.residual = values;
            if (groups_[g]->ordered) sample.sequences = group.sequences;
            // Each group determines its share of the unknowns.
            const auto unknowns = static_cast<double>(std::ssize(estimate_.parameters) + latents_);
            const double share = unknowns * static_cast<double>(values.size()) / static_cast<double>(total);
            sample.fitted = std::min(share, 0.5 * static_cast<double>(values.size()));
            sample.scale_estimated = groups_[g]->scale.estimate;
            GroupDiagnostic entry{names_[g], estimator::diagnose(sample), {}};
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

private:
    /// Normal errors that are linked by a known covariance: each record given those before it.
    void add_linked(std::size_t residual, const estimator::BlockLayout& block, VectorXd e) {
        for (Index r = 0; r < e.size(); ++r) {
            const auto group = static_cast<std::size_t>(first_[residual] + block.group[static_cast<std::size_t>(r)]);
            if (const auto* scale = scale_of(estimate_, names_[group])) e[r] /= scale->value;
        }
        models::CholeskyFactor(block.shape).solve_lower_in_place(e);
        for (int g = first_[residual]; g < first_[residual + 1]; ++g)
            collected_[static_cast<std::size_t>(g)].add(e(records_of(block, g - first_[residual])), block.label);
    }

    void add_by_law(const NoiseModel& law, std::size_t residual, const estimator::BlockLayout& block,
                    const VectorXd& all) {
        std::vector<Index> records;
        std::vector<Index> counts;
        for (const int channel : law.channels) {
            const bool here = channel >= first_[residual] && channel < first_[residual + 1];
            const auto own = here ? records_of(block, channel - first_[residual]) : std::vector<Index>{};
            counts.push_back(static_cast<Index>(own.size()));
            records.insert(records.end(), own.begin(), own.end());
        }
        if (records.empty()) return;
        VectorXd e = all(records);
        if (block.deviation.size() > 0) e.array() /= block.deviation(records).array();
        const VectorXd observed = law.needs_observed() ? VectorXd(block.observed(records)) : VectorXd();
        const VectorXd standard =
            estimator::standard_errors(law, e, observed, error_parameters(law, names_, estimate_));
        Index at = 0;
        for (std::size_t k = 0; k < law.channels.size(); ++k) {
            collected_[static_cast<std::size_t>(law.channels[k])].add(standard.segment(at, counts[k]), block.label);
            at += counts[k];
        }
    }

    const estimator::Estimate& estimate_;
    std::vector<NoiseModel> laws_;
    std::vector<std::string> names_;
    std::vector<const estimator::Group*> groups_;
    std::vector<int> first_;  ///< group of each residual, and their number
    std::vector<Collected> collected_;
    Index latents_ = 0;
};

}  // namespace

std::vector<GroupDiagnostic> diagnose_residuals(const std::vector<const estimator::Residual*>& residuals,
                                                const estimator::Estimate& estimate) {
    return WhitenedGroups(residuals, estimate).diagnostics();
}

}  // namespace orbid::identification
