#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <string>

#include <boost/math/distributions/chi_squared.hpp>

#include "estimator/uncertainty/posterior.hpp"
#include "models/arithmetic/triangular_solve.hpp"

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

/// Where the latent states go per unit of each determined parameter (column of the basis), per block of shape (latents,
/// rank).
std::vector<Eigen::MatrixXd> latent_moves(const BlockArrow& arrow, const ReducedProblem& reduced_problem,
                                          const Eigen::MatrixXd& basis) {
    const Eigen::Index rank = basis.cols();
    const std::vector<Eigen::VectorXd> still =
        latent_steps(arrow, reduced_problem, Eigen::VectorXd::Zero(basis.rows()));
    std::vector<Eigen::MatrixXd> moves;
    for (const Eigen::VectorXd& z : still)
        moves.emplace_back(z.size(), rank);
    for (Eigen::Index k = 0; k < rank; ++k) {
        const std::vector<Eigen::VectorXd> moved = latent_steps(arrow, reduced_problem, basis.col(k));
        for (std::size_t b = 0; b < moves.size(); ++b)
            moves[b].col(k) = moved[b] - still[b];
    }
    return moves;
}

/// Times of a block's records from `start`, which moves to its end: channels are aligned, the longest counts.
Eigen::VectorXd record_times(const std::vector<int>& channel, double& start) {
    std::map<int, double> total;
    double most = 0.0;
    for (const int c : channel)
        most = std::max(most, total[c] += 1.0);
    std::map<int, double> seen;
    Eigen::VectorXd time(static_cast<Eigen::Index>(channel.size()));
    for (std::size_t i = 0; i < channel.size(); ++i) {
        const int c = channel[i];
        time[static_cast<Eigen::Index>(i)] = start + (seen[c] + 0.5) / total[c] * most;
        seen[c] += 1.0;
    }
    start += most;
    return time;
}

/// The time of each standard row of a block: rows follow the records law by law.
Eigen::VectorXd row_times(const std::vector<LawPart>& parts, const std::vector<NoiseModel>& laws,
                          const Eigen::VectorXd& time) {
    if (parts.empty()) return time;
    std::vector<double> result;
    for (const LawPart& part : parts)
        for (int copy = 0; copy < laws[part.law].rows_per_record(); ++copy)
            for (const Eigen::Index record : part.records)
                result.push_back(time[record]);
    return Eigen::Map<const Eigen::VectorXd>(result.data(), static_cast<Eigen::Index>(result.size()));
}

/// Orthonormal columns that span the first `latents` columns; zero where a state is dead.
Eigen::MatrixXd orthonormal(const Eigen::MatrixXd& rows, Eigen::Index latents) {
    Eigen::MatrixXd q = rows.leftCols(latents);
    if (latents == 0) return q;
    const BlockTriangle factor = block_triangle(rows, latents);
    for (Eigen::Index j = 0; j < latents; ++j)
        if (factor.dead[static_cast<std::size_t>(j)]) q.col(j).setZero();
    models::divide_by_upper_in_place(q, factor.triangle.topLeftCorner(latents, latents));
    return q;
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
                for (std::size_t i = 0; i < block.channel().size(); ++i)
                    if (block.channel()[i] == static_cast<int>(c))
                        own.push_back(minimum_.errors.e(b)[static_cast<Eigen::Index>(i)]);
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
        for (const std::vector<LawPart>* parts : {&set_.blocks[b].parts(), &set_.blocks[b].linked_parts()})
            for (const LawPart& part : *parts) {
                const NoiseModel& law = problem_.laws[part.law];
                if (law.channels.front() != channel || part.records.empty()) continue;
                const Eigen::VectorXd e = law_errors(set_.blocks[b], part, law, minimum_.errors.e(b));
                sequences.push_back(standard_errors(law, e, part.observed, law.own(state_.psi)));
            }
    }
    return sequences;
}

/// Whether an ordered channel is more autocorrelated than its law allows. Along a chain latent states take part of
/// every residual, which makes neighbours negatively correlated: there only positive correlation counts.
bool Posterior::residuals_correlated() const {
    const bool chained = set_.constraints > 0 || set_.linked;
    return std::any_of(unexplained_.begin(), unexplained_.end(), [chained](const Autocorrelation& correlation) {
        return correlation.significant && (!chained || correlation.records > 1.0);
    });
}

void Posterior::make_sandwich() {
    const Clusters choice = problem_.options.clusters;
    if (choice == Clusters::none || point_.triangle.rows() == 0) return;
    if (choice == Clusters::blocks) {
        make_block_sandwich();
        return;
    }
    bool ordered = false;
    for (std::size_t c = 0; c < problem_.channels.size(); ++c)
        ordered = ordered || (group_of(problem_, static_cast<int>(c)).ordered && set_.spread.alone());
    if (!ordered) return;
    const bool correlated = residuals_correlated();
    if (!correlated && (set_.constraints > 0 || set_.linked)) return;
    double length = 0.0;
    std::vector<ScoreRows> rows = score_rows(length);
    if (!(length > 0.0)) return;
    const Eigen::Index dead = undetermined_states(arrow());
    const double absorbed = static_cast<double>(set_.latents - dead - set_.constraints);
    const double left = std::clamp(1.0 - absorbed / static_cast<double>(set_.records), 1e-3, 1.0);
    auto spectrum = std::make_unique<ScoreSpectrum>(std::move(rows), length, left);
    if (!correlated && !scores_correlated(*spectrum)) return;
    spectrum_ = std::move(spectrum);
    use_spectrum();
}

void Posterior::make_block_sandwich() {
    const std::size_t count = set_.blocks.size();
    const auto least = static_cast<std::size_t>(point_.triangle.rows()) + 1;
    const bool linked = set_.constraints > 0 || set_.linked;
    // Scores of all clusters add up to zero: of so few some direction would have no scatter, and so no uncertainty.
    if (linked || count < least) {
        sandwich_note_ = (set_.constraints > 0 ? std::string("constraints link the blocks")
                          : set_.linked        ? std::string("records link the blocks")
                                               : "blocks are too few (" + std::to_string(count) + ", at least " +
                                              std::to_string(least) + " are needed)") +
                         ": no clusters, intervals as if errors were independent";
        return;
    }
    std::vector<std::vector<int>> clusters;
    for (const ActiveBlock& block : set_.blocks)
        clusters.emplace_back(block.channel().size(), 0);
    const auto rows = minimum_.all_rows(problem_, set_, state_);
    sandwich_ = std::make_unique<Sandwich>(in_basis(rows, minimum_.step.from_data), set_, clusters, problem_.laws,
                                           state_.psi, point_.triangle);
    covariance_ = minimum_.step.decided * sandwich_->covariance() * minimum_.step.decided.transpose();
    sandwich_note_ = "intervals from " + std::to_string(count) + " blocks as clusters";
}

/// Whitened rows of all blocks without what latent states take, on one axis of time.
/// @param length  becomes the length of the axis, in records.
std::vector<ScoreRows> Posterior::score_rows(double& length) const {
    const Eigen::Index rank = point_.triangle.rows();
    const std::vector<BlockRows> rows = in_basis(minimum_.all_rows(problem_, set_, state_), minimum_.step.from_data);
    const std::vector<Eigen::MatrixXd> moves = latent_moves(arrow(), reduced_problem(), errors_.basis);
    const bool chained = set_.constraints > 0 || set_.linked;
    std::vector<ScoreRows> result;
    length = 0.0;
    for (const std::vector<std::size_t>& row : rows_of_blocks(set_))
        for (const std::size_t b : row) {
            const ActiveBlock& block = set_.blocks[b];
            const Eigen::VectorXd time = record_times(block.channel(), length);
            const auto add = [&](const WhitenedRows& standard, const std::vector<LawPart>& parts,
                                 const Eigen::MatrixXd& move, bool latent) {
                if (standard.rows.rows() == 0) return;
                ScoreRows scores;
                const Eigen::Index l = move.rows();
                scores.sensitivity = standard.rows.middleCols(l, rank) + standard.rows.leftCols(l) * move;
                models::divide_by_upper_in_place(scores.sensitivity, point_.triangle);
                if (latent) scores.latent = orthonormal(standard.rows, l);
                scores.residual = standard.rows.rightCols(1);
                scores.time = row_times(parts, problem_.laws, time);
                result.push_back(std::move(scores));
            };
            add(standard_rows(rows[b], problem_.laws, state_.psi, Curvature::expected), block.parts(), moves[b],
                !chained);
            if (rows[b].linked_parts.empty()) continue;
            const Eigen::MatrixXd& next = moves[static_cast<std::size_t>(rows[b].next)];
            Eigen::MatrixXd both(moves[b].rows() + next.rows(), rank);
            both << moves[b], next;
            add(standard_rows(rows[b].linked_parts, problem_.laws, state_.psi, Curvature::expected),
                block.linked_parts(), both, false);
        }
    return result;
}

/// Coefficients of the scores that belong to a direction in u.
Eigen::VectorXd Posterior::score_direction(const Eigen::VectorXd& direction) const {
    Eigen::VectorXd c = minimum_.step.decided.transpose() * direction;
    models::solve_transposed_upper_in_place(point_.triangle, c);
    return c;
}

/// Whether the long-run variance of some parameter's score is larger than independent errors would make it: a slow
/// drift beneath noise leaves the correlation of neighbours where it is.
bool Posterior::scores_correlated(const ScoreSpectrum& spectrum) const {
    const Eigen::Index q = state_.u.size();
    // One estimate in a thousand with independent errors is taken for correlated.
    const double level = 1e-3 / static_cast<double>(q);
    for (Eigen::Index i = 0; i < q; ++i) {
        const Eigen::VectorXd c = score_direction(Eigen::VectorXd::Unit(q, i));
        if (!(c.squaredNorm() > 0.0)) continue;
        const ScoreSpectrum::Ratio ratio = spectrum.along(c);
        if (!(ratio.degrees_of_freedom > 0.0)) continue;
        const boost::math::chi_squared_distribution<double> independent(ratio.degrees_of_freedom);
        if (boost::math::cdf(boost::math::complement(independent, ratio.value * ratio.degrees_of_freedom)) < level)
            return true;
    }
    return false;
}

/// The covariance with the variances of the spectrum, and the note.
void Posterior::use_spectrum() {
    const Eigen::Index q = state_.u.size();
    Eigen::VectorXd variance = Eigen::VectorXd::Zero(q);
    Eigen::Index most = 1;
    Eigen::Index fewest = std::numeric_limits<Eigen::Index>::max();
    std::string without;
    for (Eigen::Index i = 0; i < q; ++i) {
        const Eigen::VectorXd c = score_direction(Eigen::VectorXd::Unit(q, i));
        if (!(c.squaredNorm() > 0.0)) continue;
        const ScoreSpectrum::Ratio ratio = spectrum_->along(c);
        variance[i] = covariance_(i, i) * ratio.value;
        most = std::max(most, ratio.frequencies);
        fewest = std::min(fewest, ratio.frequencies);
        if (!ratio.enough)
            without += (without.empty() ? "" : ", ") + problem_.parameters[static_cast<std::size_t>(i)].name;
    }
    Eigen::MatrixXd half = spectrum_->scatter();
    models::solve_upper_in_place(point_.triangle, half);
    half = half.transpose().eval();
    models::solve_upper_in_place(point_.triangle, half);
    covariance_ = minimum_.step.decided * (0.5 * (half + half.transpose())) * minimum_.step.decided.transpose();
    Eigen::VectorXd scale = Eigen::VectorXd::Zero(q);
    for (Eigen::Index i = 0; i < q; ++i)
        if (covariance_(i, i) > 0.0) scale[i] = std::sqrt(variance[i] / covariance_(i, i));
    covariance_ = scale.asDiagonal() * covariance_ * scale.asDiagonal();
    const std::string counted = std::to_string(fewest) + (most > fewest ? " to " + std::to_string(most) : "");
    if (without.empty())
        sandwich_note_ =
            "residuals are autocorrelated: intervals from the " + counted + " lowest frequencies of the scores";
    else
        sandwich_note_ = "the residuals hold too few independent values for " + without +
                         ": the spectrum of the scores falls from the lowest frequency on, two are needed; no "
                         "interval. A longer record, or a model that leaves less structure in the residuals, would "
                         "give one";
}

}  // namespace orbid::estimator
