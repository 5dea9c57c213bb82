#include <algorithm>
#include <cmath>
#include <string>

#include "estimator/uncertainty/posterior.hpp"

namespace orbid::estimator {

namespace {

/// Blocks whose records follow each other: those of a chain in its order, every other block alone.
std::vector<std::vector<std::size_t>> rows_of_blocks(const BlockSet& set) {
    std::vector<bool> follows(set.blocks.size(), false);
    for (const ActiveBlock& block : set.blocks)
        if (block.next >= 0) follows[static_cast<std::size_t>(block.next)] = true;
    std::vector<bool> taken(set.blocks.size(), false);
    std::vector<std::vector<std::size_t>> rows;
    for (const bool ring : {false, true})
        for (std::size_t first = 0; first < set.blocks.size(); ++first) {
            if (taken[first] || (!ring && follows[first])) continue;
            rows.emplace_back();
            for (auto b = static_cast<std::ptrdiff_t>(first); b >= 0 && !taken[static_cast<std::size_t>(b)];
                 b = set.blocks[static_cast<std::size_t>(b)].next) {
                taken[static_cast<std::size_t>(b)] = true;
                rows.back().push_back(static_cast<std::size_t>(b));
            }
        }
    return rows;
}

}  // namespace

void Posterior::look_for_autocorrelation() {
    std::vector<std::vector<std::size_t>> rows;
    for (std::size_t c = 0; c < problem_.channels.size(); ++c) {
        const Group& group = group_of(problem_, static_cast<int>(c));
        if (!group.ordered || !set_.spread.alone()) {
            autocorrelations_.emplace_back();
            unexplained_.emplace_back();
            continue;
        }
        if (rows.empty()) rows = rows_of_blocks(set_);
        std::vector<Eigen::VectorXd> sequences;
        for (const std::vector<std::size_t>& row : rows) {
            std::vector<double> own;
            for (const std::size_t b : row) {
                const ActiveBlock& block = set_.blocks[b];
                for (std::size_t i = 0; i < block.channel.size(); ++i)
                    if (block.channel[i] == static_cast<int>(c))
                        own.push_back(minimum_.evaluation.values[b].e[static_cast<Eigen::Index>(i)]);
            }
            if (!own.empty())
                sequences.emplace_back(
                    Eigen::Map<const Eigen::VectorXd>(own.data(), static_cast<Eigen::Index>(own.size())));
        }
        autocorrelations_.push_back(autocorrelation(sequences));
        unexplained_.push_back(std::holds_alternative<AutoregressiveErrors>(group.distribution)
                                   ? autocorrelation(innovations(static_cast<int>(c)))
                                   : autocorrelations_.back());
    }
}

/// The innovations of a channel with autoregressive errors, block by block: independent when the law is right.
std::vector<Eigen::VectorXd> Posterior::innovations(int channel) const {
    std::vector<Eigen::VectorXd> sequences;
    for (std::size_t b = 0; b < set_.blocks.size(); ++b) {
        for (const std::vector<LawPart>* parts : {&set_.blocks[b].parts, &set_.blocks[b].linked_parts})
            for (const LawPart& part : *parts) {
                const NoiseModel& law = problem_.laws[part.law];
                if (law.channels.front() != channel || part.records.empty()) continue;
                const Eigen::VectorXd e = law_errors(set_.blocks[b], part, law, minimum_.evaluation.values[b].e);
                sequences.push_back(standard_errors(law, e, part.observed, law.own(state_.psi)));
            }
    }
    return sequences;
}

void Posterior::make_sandwich() {
    const Clusters choice = problem_.options.clusters;
    if (choice == Clusters::none || point_.triangle.rows() == 0) return;
    std::vector<std::vector<int>> clusters;
    double inflation = 1.0;
    const bool linked = set_.constraints > 0 || set_.linked;
    if (choice == Clusters::blocks) {
        for (const ActiveBlock& block : set_.blocks)
            clusters.emplace_back(block.channel.size(), 0);
    } else if (linked) {
        widen_along_chains();
        return;
    } else {
        inflation = correlated_clusters(clusters);
        if (clusters.empty()) return;
    }
    std::size_t count = 0;
    for (const std::vector<int>& cluster : clusters)
        if (!cluster.empty()) count += 1 + static_cast<std::size_t>(*std::max_element(cluster.begin(), cluster.end()));
    const auto least = static_cast<std::size_t>(point_.triangle.rows()) + 1;
    if (choice == Clusters::blocks) {
        if (linked || count < least) {
            sandwich_note_ = (set_.constraints > 0 ? std::string("constraints link the blocks")
                              : set_.linked        ? std::string("records link the blocks")
                                                   : "blocks are too few (" + std::to_string(count) + ", at least " +
                                                  std::to_string(least) + " are needed)") +
                             ": no clusters, intervals as if errors were independent";
            return;
        }
        sandwich_note_ = "intervals from " + std::to_string(count) + " blocks as clusters";
    } else if (count < least) {
        // Scores of all clusters add up to zero: of so few some direction would have no scatter, and so no uncertainty.
        widen(count);
        return;
    }
    const auto rows =
        linearise(set_, problem_.laws, minimum_.evaluation.values, problem_.coordinates, state_.theta, false);
    sandwich_ = std::make_unique<Sandwich>(in_basis(rows, minimum_.step.from_data), set_, clusters, problem_.laws,
                                           state_.psi, point_.triangle, inflation);
    covariance_ = minimum_.step.decided * sandwich_->covariance() * minimum_.step.decided.transpose();
    if (choice == Clusters::automatic)
        sandwich_note_ = "residuals are autocorrelated: intervals from " + std::to_string(sandwich_->clusters()) +
                         " clusters of consecutive records";
}

/// Integrated correlation time of the channel that is correlated longest, in records; 0: none is significantly.
double Posterior::longest_correlation() const {
    double longest = 0.0;
    for (const Autocorrelation& correlation : unexplained_)
        if (correlation.significant) longest = std::max(longest, correlation.records);
    return longest;
}

/// Latent states of a chain absorb part of every residual, so that clusters of its records have no scores of their own.
/// Covariances are widened where readings are correlated along it.
void Posterior::widen_along_chains() {
    if (!(longest_correlation() > 1.0)) return;
    widen(0);
    sandwich_note_ = "residuals are autocorrelated along a chain: intervals from the number of independent records";
}

/// Laplace's covariance as if each of the records that are worth an independent one stood for all that repeat it.
void Posterior::widen(std::size_t clusters) {
    const auto n = static_cast<double>(set_.records);
    const double longest = std::max(1.0, std::min(longest_correlation(), n));
    widening_ = longest;
    covariance_ *= widening_;
    widened_degrees_of_freedom_ = std::max(1.0, n / longest - static_cast<double>(point_.triangle.rows()));
    sandwich_note_ = "residuals repeat each other over most of a record, which makes " + std::to_string(clusters) +
                     (clusters == 1 ? " cluster" : " clusters") +
                     ", too few for a scatter: intervals from the number of independent records";
}

/// Clusters of consecutive records where residuals are more autocorrelated than their law allows; none otherwise.
/// @return factor on the covariance for correlation across the borders of clusters.
double Posterior::correlated_clusters(std::vector<std::vector<int>>& clusters) const {
    const double longest = longest_correlation();
    if (!(longest > 0.0)) return 1.0;
    // Clusters of twice the integrated correlation time: about four times the decay time of an AR(1).
    const double length = 2.0 * longest;
    for (const ActiveBlock& block : set_.blocks) {
        double most = 0.0;
        for (std::size_t c = 0; c < problem_.channels.size(); ++c) {
            if (group_of(problem_, static_cast<int>(c)).ordered)
                most = std::max(most, static_cast<double>(
                                          std::count(block.channel.begin(), block.channel.end(), static_cast<int>(c))));
        }
        clusters.push_back(consecutive_clusters(block.channel, std::max(1, static_cast<int>(most / length))));
    }
    // Correlation across the borders of clusters, AR(1) with the same integrated time tau = 2 decay times. A sum over L
    // records has the fraction 1 - (decay / L)(1 - exp(-L / decay)) of the variance it would have with all neighbours.
    const double decay = 0.5 * longest;
    return 1.0 / (1.0 - decay / length * -std::expm1(-length / decay));
}

}  // namespace orbid::estimator
