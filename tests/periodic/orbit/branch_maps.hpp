#pragma once

#include "tests/periodic/orbit/closed_form_system.hpp"

namespace orbid::tests {

/// x' = x + (1 - x^2 - lambda^2) / 4: fixed points on the unit circle, multipliers 1 - x / 2.
class CircleMap : public ClosedFormSystem {
public:
    CircleMap()
        : ClosedFormSystem(models::Kind::map, {models::real("x", "")}, {{"lambda", "", models::any_real, 0.6, ""}}) {}
    [[nodiscard]] Eigen::VectorXcd advance(const Eigen::VectorXcd& x0, double, double duration,
                                           const Eigen::VectorXcd& theta) const override {
        Eigen::VectorXcd x = x0;
        for (int k = 0; k < static_cast<int>(std::lround(duration)); ++k)
            x(0) += 0.25 * (1.0 - x(0) * x(0) - theta(0) * theta(0));
        return x;
    }
};

/// x' = x + x (lambda + skew x - x^2): fixed points 0 and lambda = x^2 - skew x, which cross at 0. Symmetric under x ->
/// -x without the skew.
class CrossingMap : public ClosedFormSystem {
public:
    explicit CrossingMap(double skew)
        : ClosedFormSystem(models::Kind::map, {models::real("x", "")}, {{"lambda", "", models::any_real, 0.0, ""}}),
          skew_(skew) {}
    [[nodiscard]] std::optional<models::Symmetry> symmetry() const override {
        if (skew_ != 0.0) return std::nullopt;
        return models::Symmetry{{-1.0}, 0.0};
    }
    [[nodiscard]] Eigen::VectorXcd advance(const Eigen::VectorXcd& x0, double, double duration,
                                           const Eigen::VectorXcd& theta) const override {
        Eigen::VectorXcd x = x0;
        for (int k = 0; k < static_cast<int>(std::lround(duration)); ++k)
            x(0) += x(0) * (theta(0) + skew_ * x(0) - x(0) * x(0));
        return x;
    }

private:
    double skew_;
};

/// x' = x + x (0.2 - lambda^2 - x^2): fixed points 0 and, between two losses of symmetry at lambda = +-sqrt(0.2), the
/// circle x^2 + lambda^2 = 0.2, whose halves are mirror images.
class ArchMap : public ClosedFormSystem {
public:
    ArchMap()
        : ClosedFormSystem(models::Kind::map, {models::real("x", "")}, {{"lambda", "", models::any_real, 0.8, ""}}) {}
    [[nodiscard]] std::optional<models::Symmetry> symmetry() const override { return models::Symmetry{{-1.0}, 0.0}; }
    [[nodiscard]] Eigen::VectorXcd advance(const Eigen::VectorXcd& x0, double, double duration,
                                           const Eigen::VectorXcd& theta) const override {
        Eigen::VectorXcd x = x0;
        for (int k = 0; k < static_cast<int>(std::lround(duration)); ++k)
            x(0) += x(0) * (0.2 - theta(0) * theta(0) - x(0) * x(0));
        return x;
    }
};

/// x' = r x (1 - x) with r = 3.2 - lambda^2: the fixed point 1 - 1 / r has doublings where r = 3, lambda = +-sqrt(0.2),
/// and one branch of period two joins them.
class BubbleMap : public ClosedFormSystem {
public:
    BubbleMap()
        : ClosedFormSystem(models::Kind::map, {models::real("x", "")}, {{"lambda", "", models::any_real, 0.8, ""}}) {}
    [[nodiscard]] Eigen::VectorXcd advance(const Eigen::VectorXcd& x0, double, double duration,
                                           const Eigen::VectorXcd& theta) const override {
        Eigen::VectorXcd x = x0;
        for (int k = 0; k < static_cast<int>(std::lround(duration)); ++k)
            x(0) = (3.2 - theta(0) * theta(0)) * x(0) * (1.0 - x(0));
        return x;
    }
};

/// x' = x / lambda: the fixed point 0, whose multiplier 1 / lambda changes its sign through infinity.
class PoleMap : public ClosedFormSystem {
public:
    PoleMap()
        : ClosedFormSystem(models::Kind::map, {models::real("x", "")}, {{"lambda", "", models::any_real, 0.5, ""}}) {}
    [[nodiscard]] Eigen::VectorXcd advance(const Eigen::VectorXcd& x0, double, double duration,
                                           const Eigen::VectorXcd& theta) const override {
        return x0 / std::pow(theta(0), std::lround(duration));
    }
};

/// x' = a x (1 - y), y' = x (the delayed logistic map): fixed point x = y = 1 - 1 / a with multipliers of product a - 1
/// and sum 1, which pass the unit circle at exp(+-i pi / 3) when a = 2.
/// Source: J. Maynard Smith, Mathematical Ideas in Biology (1968).
class DelayedLogisticMap : public ClosedFormSystem {
public:
    DelayedLogisticMap()
        : ClosedFormSystem(models::Kind::map, {models::real("x", ""), models::real("y", "")},
                           {{"a", "", models::any_real, 1.5, ""}}) {}
    [[nodiscard]] Eigen::VectorXcd advance(const Eigen::VectorXcd& x0, double, double duration,
                                           const Eigen::VectorXcd& theta) const override {
        Eigen::VectorXcd x = x0;
        for (int k = 0; k < static_cast<int>(std::lround(duration)); ++k)
            x = Eigen::Vector2cd(theta(0) * x(0) * (1.0 - x(1)), x(0));
        return x;
    }
};

}  // namespace orbid::tests
