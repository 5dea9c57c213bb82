#include "periodic/solution/guess_correction.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

#include "periodic/solution/closing_equations.hpp"

namespace orbid::periodic {

namespace {

/// Newton's method is quadratic from here on: the error of its next step is 1e-8 times a curvature.
constexpr double nearly_closed = 1e-4;

/// Weights of the closing error grow by this factor. Measured on cycles of the torque-driven pendulum: factors of 3 and
/// 10 find the same orbits, 3 at three times the cost.
constexpr double weight_growth = 10.0;
/// A guess that is not closed with this weight sits in a minimum of |F| that is no orbit.
constexpr double largest_weight = 1e8;

/// Where a path stands: unknowns and closing errors in units of the scales.
struct Place {
    VectorXd z;  ///< shape (d N + k): nodes below each other, ln (T / guess)
    ClosingError closing;
    VectorXd error;  ///< shape (d N)
};

class Path {
public:
    Path(const DiscreteEquations& equations, const MatrixXd& guess, double time, const std::vector<Index>& measured)
        : equations_(equations),
          guess_(guess),
          time_(time),
          scales_(equations.scale.replicate(guess.cols(), 1)),
          weights_(VectorXd::Zero(guess.size() + (unknown_time() ? 1 : 0))) {
        for (const Index j : measured)
            weights_.segment(guess.rows() * j, guess.rows()).setOnes();
        if (unknown_time()) weights_.tail(1).setOnes();
    }

    [[nodiscard]] MatrixXd nodes(const VectorXd& z) const {
        return guess_ + z.head(guess_.size()).cwiseProduct(scales_).reshaped(guess_.rows(), guess_.cols());
    }
    [[nodiscard]] double time(const VectorXd& z) const {
        return unknown_time() ? time_ * std::exp(z(z.size() - 1)) : time_;
    }
    [[nodiscard]] Place at_guess(const ClosingError& closing) const {
        return {VectorXd::Zero(weights_.size()), closing, closing.error.reshaped().cwiseQuotient(scales_)};
    }
    [[nodiscard]] Place at(const VectorXd& z) const {
        Place place{z, closing_error(equations_.discretisation, nodes(z), time(z), equations_.turns), {}};
        if (place.closing.simulated) place.error = place.closing.error.reshaped().cwiseQuotient(scales_);
        return place;
    }
    [[nodiscard]] double cost(const Place& place, double weight) const {
        return place.z.cwiseProduct(weights_).squaredNorm() + weight * place.error.squaredNorm();
    }
    [[nodiscard]] VectorXd step(const Place& place, double weight) const {
        const ClosingEquations equations(place.closing, equations_.scale, weight, weights_);
        if (!equations.regular()) return VectorXd::Zero(place.z.size());
        const VectorXd pull = weights_.cwiseProduct(place.z) + equations.weighted_pull(place.error);
        return -equations.solve(pull);
    }
    /// One damped step; false when none makes the cost smaller.
    [[nodiscard]] bool advance(Place& place, double weight, double& length_of_step) const {
        const VectorXd direction = step(place, weight);
        const double before = cost(place, weight);
        constexpr int halvings = 7;  // 1 / 128: shorter steps than that lead nowhere in the end
        double length = 1.0;
        for (int i = 0; i <= halvings; ++i, length *= 0.5) {
            Place trial = at(place.z + length * direction);
            if (!trial.closing.simulated || !(cost(trial, weight) < before)) continue;
            place = std::move(trial);
            length_of_step = length * direction.norm();
            return true;
        }
        return false;
    }

private:
    [[nodiscard]] bool unknown_time() const { return equations_.discretisation.unknown_time(); }

    const DiscreteEquations& equations_;
    const MatrixXd& guess_;
    double time_;
    VectorXd scales_;
    VectorXd weights_;
};

}  // namespace

double shortest_correction(const ClosingError& closing, const VectorXd& scale, double weight) {
    const ClosingEquations equations(closing, scale, weight);
    const VectorXd error = (closing.error.array().colwise() / scale.array()).matrix().reshaped();
    const VectorXd pull = equations.weighted_pull(error);
    const VectorXd move = -equations.solve(pull);
    return std::sqrt(std::max(weight * error.squaredNorm() + pull.dot(move), 0.0));
}

CorrectedGuess corrected_guess(const DiscreteEquations& equations, const MatrixXd& guess, double time,
                               const ClosingError& closing, const std::vector<Index>& measured) {
    const Path path(equations, guess, time, measured);
    Place place = path.at_guess(closing);
    const double size = std::sqrt(static_cast<double>(place.error.size()));
    CorrectedGuess result;
    for (double weight = 1.0; weight <= largest_weight && !result.closed; weight *= weight_growth) {
        // Two steps per weight: the first one from the solution for another weight, the second corrects it.
        double length = 0.0;
        for (int i = 0; i < 2 && !result.closed; ++i) {
            if (!path.advance(place, weight, length)) break;
            result.closed = place.error.norm() < nearly_closed * size;
            if (length < 1e-4 * size) break;
        }
    }
    result.nodes = path.nodes(place.z);
    result.time = path.time(place.z);
    result.closing = std::move(place.closing);
    return result;
}

}  // namespace orbid::periodic
