#include "orbits/spline_map/spline_map_fit.hpp"

#include <algorithm>
#include <array>
#include <cmath>

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include "models/arithmetic/lu_factor.hpp"
#include "orbits/spline_map/spline_normal_matrix.hpp"
#include "orbits/spline_map/spline_roughness.hpp"
#include "orbits/spline_map/tiled_cholesky.hpp"

namespace orbid::orbits {
namespace {

// Prior on every coefficient: sd of ten ranges (turns). It only matters for patches at the border that neither data nor
// neighbours hold; what it leaves open shows in the covariance.
constexpr double coefficient_ridge = 1e-2;

// Points of a longer section are smoothed by the map of a shorter one this often before they have one of their own.
constexpr int smoothing_passes = 8;

Eigen::MatrixXd read_points(const SectionPoints& section) {
    return Eigen::Map<const Eigen::MatrixXd>(section.point(0), section.dimension(),
                                             static_cast<Eigen::Index>(section.size()));
}

class Fitter {
public:
    // @param places  where the map is to be known, shape (n, any)
    Fitter(const SectionPoints& section, const Eigen::MatrixXd& places, const Eigen::VectorXd& offset,
           const Eigen::MatrixXd& reading_covariance, const SplineMapFitOptions& options)
        : section_(section),
          reading_(reading_covariance),
          options_(options),
          n_(section.dimension()),
          fit_(SplineMap(SplineBasis(section, places, options.spacing), offset, section.signs()),
               1e-4 * reading_covariance.diagonal()) {
        fit_.states = read_points(section);
        for (Eigen::Index d = 0; d < n_; ++d)
            roughness_.emplace_back(fit_.map.basis(), d);
        fit_.remaining.assign(section.size(), SmallMatrix(reading_));
    }

    SplineMapFit first(const SectionLift& lift) {
        displacement_ = lift.displacement;
        std::vector<char> present(section_.size());
        for (std::size_t t = 0; t < section_.size(); ++t)
            present[t] = section_.has_image(t) ? 1 : 0;
        start(displacement_, present);
        return run();
    }

    SplineMapFit next(const SplineMapFit& before) {
        displacement_ = displacements_as_read(section_);
        if (before.states.cols() == fit_.states.cols()) {
            fit_.states = before.states;
            fit_.remaining = before.remaining;
        } else {
            for (int pass = 0; pass < smoothing_passes; ++pass)
                smooth_by(before, std::pow(options_.first_share, pass / (smoothing_passes - 1.0)));
        }
        Eigen::MatrixXd displacement = displacement_;
        const std::vector<char> present = take_turns(before.map, displacement);
        start(std::move(displacement), present);
        return run();
    }

    SplineMapFit unusable() { return std::move(fit_); }

private:
    SplineMapFit run() {
        for (int pass = 0; pass < options_.passes && good_; ++pass) {
            const double fall = options_.passes > 1
                                    ? std::pow(options_.last_share / options_.first_share,
                                               std::min(1.0, pass / std::max(1.0, options_.passes - 3.0)))
                                    : 1.0;
            improve(pass, options_.first_share * fall);
        }
        fit_.usable = good_;
        return std::move(fit_);
    }

    // Ordinary least squares: reading errors of the place neglected, variance of the rest from the residuals.
    // @param target  displacements with their turns
    void start(Eigen::MatrixXd target, const std::vector<char>& present) {
        const SplineDesign design(fit_.map, fit_.states, present, section_.interrupted());
        const std::vector<double> normal = design.normal_matrix(nullptr);
        for (Eigen::Index t = 0; t < target.cols(); ++t)
            if (present[static_cast<std::size_t>(t)])
                target.col(t) += image_shift(t) - fit_.map.offset();
            else
                target.col(t).setZero();
        const Eigen::VectorXd right = design.gathered(target);
        const double scale = mean_diagonal(normal);
        Eigen::VectorXd variance = Eigen::VectorXd::Ones(n_);
        for (SplineRoughness& roughness : roughness_)
            roughness.set_weight(1e-3 * scale);
        for (int round = 0; round < 4; ++round) {
            const TiledCholesky factor(penalised(normal, coefficient_ridge * variance.mean()),
                                       static_cast<std::size_t>(right.size()), &section_.interrupted());
            if (!(good_ = factor.positive_definite())) return;
            Eigen::VectorXd solution = right;
            factor.solve(solution.data());
            fit_.map.set_coefficients(solution);
            const Eigen::MatrixXd residual = target - design.spread(solution);
            fit_.unexplained = 0.0;
            for (Eigen::Index d = 0; d < n_; ++d) {
                variance[d] = residual.row(d).squaredNorm() / static_cast<double>(section_.image_count());
                fit_.unexplained += variance[d] / image_variance(d) / static_cast<double>(n_);
            }
            // Other weights cannot help so much: spare the rounds.
            if (!(good_ = fit_.unexplained < 2.0 * options_.largest_unexplained)) return;
            const std::vector<double> root = factor.inverse_factor();
            for (Eigen::Index d = 0; d < n_; ++d)
                roughness_[static_cast<std::size_t>(d)].reweigh(root, solution, variance[d], least_difference(d),
                                                                section_.interrupted());
        }
        for (Eigen::Index d = 0; d < n_; ++d)
            roughness_[static_cast<std::size_t>(d)].scale_weight(1.0 / variance[d]);
        good_ = fit_.unexplained < options_.largest_unexplained;
    }

    // Turns of displacements nearest to a map. Returns which points have an image and lie where the map is known.
    std::vector<char> take_turns(const SplineMap& map, Eigen::MatrixXd& displacement) const {
        std::vector<char> known(section_.size(), 0);
        MapValue value;
        for (Eigen::Index t = 0; t < displacement.cols(); ++t) {
            const auto i = static_cast<std::size_t>(t);
            if (!section_.has_image(i)) continue;
            map.evaluate(fit_.states.col(t).data(), 1, value);
            known[i] = value.inside ? 1 : 0;
            if (!value.inside) continue;
            const Eigen::VectorXd shift = image_shift(t);
            for (Eigen::Index d = 0; d < n_; ++d)
                if (section_.is_angle(d))
                    displacement(d, t) -= std::nearbyint(displacement(d, t) + shift[d] - value.displacement[d]);
        }
        return known;
    }

    // Variance of third differences that are as good as none: a hundredth of the reading error, squared.
    [[nodiscard]] double least_difference(Eigen::Index d) const { return 1e-4 * reading_(d, d); }

    // By how much smoothing moved the image of a point more than the point.
    [[nodiscard]] Eigen::VectorXd image_shift(Eigen::Index t) const {
        Eigen::VectorXd shift(n_);
        for (Eigen::Index d = 0; d < n_; ++d)
            shift[d] =
                section_.difference(fit_.states(d, t + 1), section_.point(static_cast<std::size_t>(t + 1))[d], d) -
                section_.difference(fit_.states(d, t), section_.point(static_cast<std::size_t>(t))[d], d);
        return shift;
    }

    // Variance of the images about their mean; uniform around the circle for angles.
    [[nodiscard]] double image_variance(Eigen::Index d) const {
        if (section_.is_angle(d)) return 1.0 / 12.0;
        double sum = 0.0, squares = 0.0;
        for (std::size_t t = 0; t < section_.size(); ++t)
            if (section_.has_image(t)) {
                sum += section_.point(t + 1)[d];
                squares += section_.point(t + 1)[d] * section_.point(t + 1)[d];
            }
        const auto count = static_cast<double>(section_.image_count());
        return squares / count - sum * sum / (count * count);
    }

    /// Errors in points and images about a map, and what the map leaves over.
    struct Residuals {
        ReadingSmoother smoother;
        Eigen::MatrixXd residual;
        std::vector<char> present;
    };

    [[nodiscard]] Residuals residuals(const SplineMap& map, const PatchModelError& model_error, double share) const {
        const std::size_t count = section_.size();
        std::vector<SeriesStep> steps(count);
        tbb::parallel_for(tbb::blocked_range<std::size_t>(0, count, 256),
                          [&](const tbb::blocked_range<std::size_t>& range) {
                              MapValue value;
                              for (std::size_t t = range.begin(); t < range.end(); ++t)
                                  if (section_.has_image(t))
                                      steps[t] = linearised(t, map, model_error, share * share, value);
                          });
        Eigen::MatrixXd residual = Eigen::MatrixXd::Zero(n_, static_cast<Eigen::Index>(count));
        std::vector<char> present(count, 0);
        for (std::size_t t = 0; t < count; ++t) {
            if (!steps[t].present) continue;
            residual.col(static_cast<Eigen::Index>(t)) = steps[t].residual;
            present[t] = 1;
        }
        return {ReadingSmoother(std::move(steps), reading_, options_.gate), std::move(residual), std::move(present)};
    }

    // States by a map that was fitted to other points.
    void smooth_by(const SplineMapFit& other, double share) {
        const auto [smoother, residual, present] = residuals(other.map, other.model_error, share);
        move_states(smoother, smoother.weighted(residual));
    }

    void improve(int pass, double model_share) {
        const bool last = pass + 1 == options_.passes;
        auto [smoother, residual, present] = residuals(fit_.map, fit_.model_error, model_share);
        const SplineDesign design(fit_.map, fit_.states, present, section_.interrupted());
        const std::vector<double> normal = design.normal_matrix(&smoother);
        Eigen::VectorXd step = design.gathered(smoother.weighted(residual));
        step -= coefficient_ridge * fit_.map.coefficients();
        for (const SplineRoughness& roughness : roughness_)
            step -= roughness.times(fit_.map.coefficients());
        const TiledCholesky factor(penalised(normal, coefficient_ridge), static_cast<std::size_t>(step.size()),
                                   &section_.interrupted());
        if (!(good_ = factor.positive_definite())) return;
        factor.solve(step.data());
        fit_.map.set_coefficients(fit_.map.coefficients() + step);
        residual -= design.spread(step);
        const Eigen::MatrixXd weighted = smoother.weighted(residual);
        fit_.chi2 = weighted.cwiseProduct(residual).sum();
        if (pass > 0) fit_.model_error.update(fit_.map.basis(), fit_.states, weighted, smoother);
        move_states(smoother, weighted);
        if (last) put_back(factor);

        std::vector<double> root = factor.inverse_factor();
        double freedom = 0.0;  // effective number of coefficients
        for (Eigen::Index d = 0; d < n_; ++d)
            freedom += roughness_[static_cast<std::size_t>(d)].reweigh(root, fit_.map.coefficients(), 1.0,
                                                                       least_difference(d), section_.interrupted());
        fit_.chi2 /= static_cast<double>(n_) * static_cast<double>(section_.image_count()) - freedom;
        if (last) fit_.root = std::move(root);
    }

    // Twicing (Tukey, Exploratory Data Analysis, 1977): the prior has pulled the coefficients c away from what the data
    // say by (N + P)^-1 P c; put back once, its pull is of second order. At noise 5e-3 it shifted all cycles together:
    // a length estimated from 142 of them was 0.073 % too large, then 0.058 %; their positions became 5 % better.
    // (A tenth of the weights instead: 0.047 %, but 14 cycles fewer and multipliers 30 % worse.)
    void put_back(const TiledCholesky& factor) {
        const Eigen::VectorXd& c = fit_.map.coefficients();
        Eigen::VectorXd pull = coefficient_ridge * c;
        for (const SplineRoughness& roughness : roughness_)
            pull += roughness.times(c);
        factor.solve(pull.data());
        fit_.map.set_coefficients(c + pull);
    }

    SeriesStep linearised(std::size_t t, const SplineMap& map, const PatchModelError& model_error, double share2,
                          MapValue& value) const {
        section_.stop_if_asked();
        SeriesStep step;
        const auto at = static_cast<Eigen::Index>(t);
        map.evaluate(fit_.states.col(at).data(), 2, value);
        if (!value.inside) return step;
        step.present = true;
        step.jacobian = value.jacobian;
        step.model = share2 * reading_;
        step.model.diagonal() += model_error.variance(map.basis(), fit_.states.col(at).data());
        SmallVector moved(n_);
        std::array<SmallMatrix, 4> curved;
        for (Eigen::Index d = 0; d < n_; ++d) {
            moved[d] = section_.difference(section_.point(t)[d], fit_.states(d, at), d);
            curved[static_cast<std::size_t>(d)] = value.bending[static_cast<std::size_t>(d)] * fit_.remaining[t];
        }
        for (Eigen::Index a = 0; a < n_; ++a)
            for (Eigen::Index b = 0; b < n_; ++b)
                step.model(a, b) +=
                    0.5 * (curved[static_cast<std::size_t>(a)] * curved[static_cast<std::size_t>(b)]).trace();
        step.residual = displacement_.col(at) - value.displacement + moved;
        // Turns by the smoothed point: errors of the one that was read may grow to more than half a turn.
        for (Eigen::Index d = 0; d < n_; ++d)
            if (section_.is_angle(d)) step.residual[d] -= std::nearbyint(step.residual[d]);
        step.residual -= step.jacobian * moved;
        return step;
    }

    void move_states(const ReadingSmoother& smoother, const Eigen::MatrixXd& weighted) {
        const Eigen::MatrixXd errors = smoother.reading_errors(weighted);
        const SmallMatrix precision = models::inverse(SmallMatrix(reading_));
        for (std::size_t t = 0; t < section_.size(); ++t) {
            const auto at = static_cast<Eigen::Index>(t);
            SmallVector error = errors.col(at);
            const double size2 = error.dot(precision * error);
            if (size2 > 16.0) error *= 4.0 / std::sqrt(size2);
            const Eigen::Map<const Eigen::VectorXd> read(section_.point(t), n_);
            Eigen::VectorXd moved = section_.wrapped(read - error);
            SplineSupport support;
            if (moved.allFinite()) {
                fit_.map.basis().support(moved.data(), 0, support);
                fit_.states.col(at) = support.inside ? moved : Eigen::VectorXd(read);
            }
            fit_.remaining[t] = smoother.remaining_covariance(t);
        }
    }

    [[nodiscard]] static double mean_diagonal(const std::vector<double>& matrix) {
        const auto size = static_cast<std::size_t>(std::sqrt(static_cast<double>(matrix.size())) + 0.5);
        double sum = 0.0;
        for (std::size_t i = 0; i < size; ++i)
            sum += matrix[i * size + i];
        return sum / static_cast<double>(size);
    }

    [[nodiscard]] std::vector<double> penalised(std::vector<double> matrix, double diagonal) const {
        const auto size = static_cast<std::size_t>(fit_.map.basis().unknowns());
        for (std::size_t i = 0; i < size; ++i)
            matrix[i * size + i] += diagonal;
        for (const SplineRoughness& roughness : roughness_)
            roughness.add_to(matrix);
        return matrix;
    }

    const SectionPoints& section_;
    SmallMatrix reading_;
    SplineMapFitOptions options_;
    Eigen::Index n_;
    SplineMapFit fit_;
    std::vector<SplineRoughness> roughness_;
    Eigen::MatrixXd displacement_;  ///< from every point to its image, turns of angles any
    bool good_ = true;
};

}  // namespace

SplineMapFit fit_spline_map(const SectionPoints& section, const SectionLift& lift,
                            const Eigen::MatrixXd& reading_covariance, const SplineMapFitOptions& options) {
    return Fitter(section, read_points(section), lift.offset, reading_covariance, options).first(lift);
}

SplineMapFit fit_spline_map(const SectionPoints& section, const SplineMapFit& before,
                            const Eigen::MatrixXd& reading_covariance, const SplineMapFitOptions& options) {
    Fitter fitter(section, before.states, before.map.offset(), reading_covariance, options);
    return before.usable ? fitter.next(before) : fitter.unusable();
}

}  // namespace orbid::orbits
