#include "estimator/sampling/posterior_density.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

#include "estimator/interface/not_finite.hpp"
#include "estimator/problem/linearisation.hpp"
#include "models/arithmetic/eigenvalues.hpp"

namespace orbid::estimator {

namespace {

/// The errors of a block alone, as short as its laws allow: all that -ln p needs as a function of psi.
BlockRows errors_alone(const BlockRows& block, const std::vector<PartRows>& parts) {
    BlockRows errors;
    errors.cholesky = block.cholesky;
    errors.channel = block.channel;
    if (block.rows.size() > 0) errors.rows = block.rows.rightCols(1);
    for (const PartRows& part : parts)
        errors.parts.push_back({part.law, {part.records.rows.rightCols(1), part.records.observed, part.records.count}});
    return errors;
}

/// Where the latent states of each active block begin in (u, z, psi).
std::vector<Eigen::Index> latent_places(const BlockSet& set, Eigen::Index parameters) {
    std::vector<Eigen::Index> place;
    for (const ActiveBlock& block : set.blocks) {
        place.push_back(parameters);
        parameters += block.latents;
    }
    return place;
}

/// Which entries of (u, z, psi) the columns of a block's rows belong to.
std::vector<Eigen::Index> columns_of(const std::vector<Eigen::Index>& latent, std::size_t b, const BlockRows& block,
                                     bool linked, Eigen::Index parameters) {
    std::vector<Eigen::Index> columns;
    for (Eigen::Index j = 0; j < block.latents; ++j)
        columns.push_back(latent[b] + j);
    for (Eigen::Index j = 0; linked && j < block.next_latents; ++j)
        columns.push_back(latent[static_cast<std::size_t>(block.next)] + j);
    for (Eigen::Index j = 0; j < parameters; ++j)
        columns.push_back(j);
    return columns;
}

/// Covariance from information. Eigenvalues of the matrix at unit diagonal that are not clearly positive (differences
/// of a gradient, places that are no maximum) are raised to a fraction that leaves steps of a sensible size.
Eigen::MatrixXd inverse(const Eigen::MatrixXd& information) {
    constexpr double least = 1e-10;
    Eigen::VectorXd size = information.diagonal();
    for (double& value : size)
        value = value > 0.0 && std::isfinite(value) ? 1.0 / std::sqrt(value) : 1.0;
    const Eigen::MatrixXd scaled = size.asDiagonal() * information * size.asDiagonal();
    const models::SymmetricEigen eigen = models::symmetric_eigen(0.5 * (scaled + scaled.transpose()));
    const Eigen::VectorXd values = eigen.values.cwiseMax(least);
    const Eigen::MatrixXd root = size.asDiagonal() * eigen.vectors * values.cwiseSqrt().cwiseInverse().asDiagonal();
    return root * root.transpose();
}

}  // namespace

PosteriorDensity::PosteriorDensity(const Problem& problem, const BlockSet& set, PosteriorPlace start)
    : problem_(problem), set_(set), base_(std::move(start)) {
    for (Eigen::Index i = 0; i < parameters(); ++i)
        parameter_maps_.push_back({problem.lower[i], problem.upper[i]});
    for (std::size_t k = 0; k < problem.errors.size(); ++k)
        if (problem.errors[k].estimate) {
            free_errors_.push_back(static_cast<Eigen::Index>(k));
            error_maps_.push_back({problem.errors[k].lower, problem.errors[k].upper});
        }
    const Eigen::Index errors = static_cast<Eigen::Index>(free_errors_.size());
    const Eigen::Index count = parameters() + set.latents + errors;

    // Sds in (u, z, psi) decide what is far enough inside, and give the maps their widths.
    Eigen::VectorXd gradient(count);
    if (!std::isfinite(value(base_, gradient))) return;
    Eigen::MatrixXd h = information(base_);
    Eigen::VectorXd sd(count);
    for (Eigen::Index i = 0; i < count; ++i) {
        // At a bound the density may fall much faster than its curvature suggests.
        const double least =
            std::max(std::sqrt(std::max(h(i, i), 0.0)), map(i) != nullptr ? std::abs(gradient[i]) : 0.0);
        sd[i] = least > 0.0 ? 1.0 / least : 1.0;
    }
    go_inside(base_, sd);
    if (!std::isfinite(value(base_, gradient))) return;
    h = information(base_);

    start_.resize(count);
    start_.head(parameters()) = base_.u;
    Eigen::Index at = parameters();
    for (const ActiveBlock& block : set.blocks) {
        start_.segment(at, block.latents) = base_.latents[block.residual][block.block];
        at += block.latents;
    }
    for (const Eigen::Index k : free_errors_)
        start_[at++] = base_.psi[k];
    // d2/dv2 = slope^2 d2/du2 + slope' d/du - (ln slope)''.
    Eigen::VectorXd slope = Eigen::VectorXd::Ones(count);
    Eigen::VectorXd added = Eigen::VectorXd::Zero(count);
    for (Eigen::Index i = 0; i < count; ++i) {
        const UnboundedCoordinate* limits = map(i);
        if (limits == nullptr) continue;
        const double v = limits->at(start_[i]);
        start_[i] = v;
        slope[i] = limits->slope(v);
        added[i] = slope[i] * limits->ln_slope_first(v) * gradient[i] - limits->ln_slope_second(v);
    }
    h = slope.asDiagonal() * h * slope.asDiagonal();
    h.diagonal() += added;
    covariance_ = inverse(h);
}

Eigen::MatrixXd PosteriorDensity::parameter_covariance() const {
    if (covariance_.size() == 0) return {};
    const Eigen::Index q = parameters();
    Eigen::VectorXd slope(q);
    for (Eigen::Index i = 0; i < q; ++i)
        slope[i] = map(i)->slope(start_[i]);
    return slope.asDiagonal() * covariance_.topLeftCorner(q, q) * slope.asDiagonal();
}

/// The map of coordinate i of x; null for a latent state.
const UnboundedCoordinate* PosteriorDensity::map(Eigen::Index i) const {
    if (i < parameters()) return &parameter_maps_[static_cast<std::size_t>(i)];
    const Eigen::Index error = i - parameters() - set_.latents;
    return error < 0 ? nullptr : &error_maps_[static_cast<std::size_t>(error)];
}

/// Moves what lies on a limit, or within a tenth of its sd of it, to ln 2 of its sd inside (v = 0).
void PosteriorDensity::go_inside(PosteriorPlace& place, const Eigen::VectorXd& sd) {
    const auto inside = [](UnboundedCoordinate& limits, double& u, double size) {
        if (!limits.has_lower() && !limits.has_upper()) return;
        const bool both = limits.has_lower() && limits.has_upper();
        const double reach = both ? std::min(size, 0.5 * (limits.upper - limits.lower)) : size;
        limits.width = reach;
        const double distance = std::log(2.0) * reach;
        if (limits.has_lower() && !(u - limits.lower > 0.1 * reach)) u = limits.lower + distance;
        if (limits.has_upper() && !(limits.upper - u > 0.1 * reach)) u = limits.upper - distance;
    };
    for (Eigen::Index i = 0; i < parameters(); ++i)
        inside(parameter_maps_[static_cast<std::size_t>(i)], place.u[i], sd[i]);
    for (std::size_t k = 0; k < free_errors_.size(); ++k)
        inside(error_maps_[k], place.psi[free_errors_[k]],
               sd[parameters() + set_.latents + static_cast<Eigen::Index>(k)]);
}

PosteriorPlace PosteriorDensity::place(const Eigen::VectorXd& x) const {
    PosteriorPlace place = base_;
    for (Eigen::Index i = 0; i < parameters(); ++i)
        place.u[i] = map(i)->bounded(x[i]);
    Eigen::Index at = parameters();
    for (const ActiveBlock& block : set_.blocks) {
        place.latents[block.residual][block.block] = x.segment(at, block.latents);
        at += block.latents;
    }
    for (const Eigen::Index k : free_errors_) {
        place.psi[k] = map(at)->bounded(x[at]);
        ++at;
    }
    return place;
}

double PosteriorDensity::operator()(const Eigen::VectorXd& x, Eigen::VectorXd* gradient) const {
    if (!x.allFinite()) return infinity;
    Eigen::VectorXd slope(x.size());
    double result = value(place(x), slope);
    for (Eigen::Index i = 0; i < x.size(); ++i) {
        const UnboundedCoordinate* limits = map(i);
        if (limits == nullptr) continue;
        result -= limits->ln_slope(x[i]);
        slope[i] = slope[i] * limits->slope(x[i]) - limits->ln_slope_first(x[i]);
    }
    if (gradient != nullptr) *gradient = std::move(slope);
    return result;
}

double PosteriorDensity::value(const PosteriorPlace& place, Eigen::VectorXd& gradient) const {
    const Eigen::Index q = parameters();
    const Eigen::VectorXd theta = natural(place);
    const Evaluation evaluation = evaluate(problem_.residuals, set_, problem_.laws, theta, place.latents, true);
    if (!evaluation.failed.empty()) return infinity;
    double result = 0.5 * set_.ln_det_shapes;
    gradient.setZero(q + set_.latents + static_cast<Eigen::Index>(free_errors_.size()));
    const std::vector<Eigen::Index> latent = latent_places(set_, q);
    // Not compressed: the gradient needs each row once, a factorisation costs more.
    const std::vector<BlockRows> rows =
        linearise(set_, problem_.laws, evaluation.values, problem_.coordinates, theta, false);
    const auto add = [&](std::size_t b, const std::vector<PartRows>& parts, const WhitenedRows& standard) {
        result += standard.value;
        if (standard.rows.size() == 0) return;
        const Eigen::VectorXd slope =
            standard.rows.leftCols(standard.rows.cols() - 1).transpose() * standard.rows.rightCols(1);
        gradient(columns_of(latent, b, rows[b], &parts == &rows[b].linked_parts, q)) += slope;
        const BlockRows errors = errors_alone(rows[b], parts);
        const WhitenedRows at{standard.rows.rightCols(1), standard.value};
        for (std::size_t k = 0; k < free_errors_.size(); ++k)
            gradient[q + set_.latents + static_cast<Eigen::Index>(k)] +=
                standard_rows_derivative(errors, errors.parts, problem_.laws, place.psi, free_errors_[k],
                                         Curvature::step, at)
                    .value;
    };
    for (std::size_t b = 0; b < rows.size(); ++b) {
        add(b, rows[b].parts, standard_rows(rows[b], problem_.laws, place.psi, Curvature::step));
        add(b, rows[b].linked_parts, standard_rows(rows[b].linked_parts, problem_.laws, place.psi, Curvature::step));
    }

    const PriorModel prior = prior_at(problem_, place.u);
    result += prior.value;
    gradient.head(q) += prior.gradient;
    for (const NoiseModel& law : problem_.laws) {
        const Eigen::VectorXd psi = law.own(place.psi);
        result += prior_term(law, psi);
        for (std::size_t k = 0; k < free_errors_.size(); ++k)
            if (law.has(free_errors_[k]))
                gradient[q + set_.latents + static_cast<Eigen::Index>(k)] +=
                    prior_slope(law, psi, free_errors_[k] - law.first);
    }
    return std::isnan(result) ? infinity : result;
}

Eigen::MatrixXd PosteriorDensity::information(const PosteriorPlace& place) const {
    const Eigen::Index q = parameters();
    const auto errors = static_cast<Eigen::Index>(free_errors_.size());
    const Eigen::Index count = q + set_.latents + errors;
    const Eigen::VectorXd theta = natural(place);
    Eigen::MatrixXd h = Eigen::MatrixXd::Zero(count, count);
    const Evaluation evaluation = evaluate(problem_.residuals, set_, problem_.laws, theta, place.latents, true);
    const std::vector<Eigen::Index> latent = latent_places(set_, q);
    const std::vector<BlockRows> rows =
        linearise(set_, problem_.laws, evaluation.values, problem_.coordinates, theta, true);
    const auto add = [&](std::size_t b, bool linked, const WhitenedRows& standard) {
        if (standard.rows.size() == 0) return;
        const auto columns = columns_of(latent, b, rows[b], linked, q);
        const auto own = standard.rows.leftCols(standard.rows.cols() - 1);
        h(columns, columns) += own.transpose() * own;
    };
    for (std::size_t b = 0; b < rows.size(); ++b) {
        add(b, false, standard_rows(rows[b], problem_.laws, place.psi, Curvature::expected));
        add(b, true, standard_rows(rows[b].linked_parts, problem_.laws, place.psi, Curvature::expected));
    }
    const PriorModel prior = prior_at(problem_, place.u);
    if (prior.rows.rows() > 0) h.topLeftCorner(q, q) += prior.rows.transpose() * prior.rows;
    for (std::size_t k = 0; k < free_errors_.size(); ++k) {
        // Coordinates are logarithms, or of the size of the errors: a ten-thousandth changes the gradient enough.
        const Eigen::Index own = free_errors_[k];
        double step = 1e-4;
        if (problem_.errors[static_cast<std::size_t>(own)].kind == ErrorCoordinate::Kind::linear) {
            const NoiseModel& law = *std::find_if(problem_.laws.begin(), problem_.laws.end(),
                                                  [own](const NoiseModel& candidate) { return candidate.has(own); });
            step *= law.scale(law.own(place.psi), 0);
        }
        PosteriorPlace ahead = place;
        PosteriorPlace behind = place;
        ahead.psi[own] += step;
        behind.psi[own] -= step;
        Eigen::VectorXd more(count);
        Eigen::VectorXd less(count);
        const Eigen::Index column = q + set_.latents + static_cast<Eigen::Index>(k);
        if (!std::isfinite(value(ahead, more)) || !std::isfinite(value(behind, less))) {
            h(column, column) = 1.0;
            continue;
        }
        h.col(column) = (more - less) / (2.0 * step);
        h.row(column).head(column) = h.col(column).head(column).transpose();
    }
    return h;
}

}  // namespace orbid::estimator
