#pragma once

#include <optional>
#include <span>
#include <utility>
#include <vector>

#include <Eigen/Core>

#include "models/arithmetic/matrix_layout.hpp"
#include "models/system/system.hpp"

#pragma GCC visibility push(default)

namespace orbid::orbits {

/// Where a section lies: at a phase of the forcing, at every iterate of a map, or where an autonomous flow crosses a
/// plane on which one coordinate is constant.
struct SectionPlace {
    SectionPlace(double at_phase = 0.0) : phase(at_phase) {}  // NOLINT: most sections are phases
    explicit SectionPlace(models::Section crossed) : plane(std::move(crossed)) {}

    double phase = 0.0;                    ///< [rad] (forced models)
    std::optional<models::Section> plane;  ///< autonomous flows: its normal along one coordinate
};

/// A section point one period (iterate, crossing) later.
struct SectionImage {
    Eigen::VectorXd state;    ///< shape (n), angles not wrapped
    Eigen::MatrixXd by_x;     ///< X of (M4), shape (n, n); empty without derivatives
    Eigen::MatrixXd by_free;  ///< Y of (M4), shape (n, f)
};

/// x -> Phi(x; theta) over one period of the forcing, one step of a map, or from crossing to crossing.
///
/// Section points have the coordinates of the model; crossings of a plane lack the plane's own.
class SectionMap {
public:
    /// The system is kept by pointer.
    /// @throws std::invalid_argument for a phase that is not finite, an autonomous system without a plane or with one
    ///         whose normal is not along a coordinate, another system with a plane.
    SectionMap(const models::System& system, const SectionPlace& place, const models::FlowOptions& flow);

    /// Empty when the flow fails. @param theta full parameter vector; @param free parameters of the derivatives.
    [[nodiscard]] std::optional<SectionImage> operator()(const Eigen::VectorXd& x, const Eigen::VectorXd& theta,
                                                         std::span<const Eigen::Index> free, bool derivatives) const;

    [[nodiscard]] const models::System& system() const { return *system_; }
    [[nodiscard]] const SectionPlace& place() const { return place_; }
    [[nodiscard]] double phase() const { return place_.phase; }
    [[nodiscard]] const models::FlowOptions& flow() const { return flow_; }

    /// Of section points.
    [[nodiscard]] const std::vector<models::Coordinate>& coordinates() const { return coordinates_; }
    [[nodiscard]] Eigen::Index dimension() const { return static_cast<Eigen::Index>(coordinates_.size()); }

    /// States of the model at section points, shape (model's n, m).
    [[nodiscard]] Eigen::MatrixXd states(const Eigen::MatrixXd& points) const;
    /// Section points of states on the section, or their derivatives: the rows kept of every n rows of the model.
    [[nodiscard]] Eigen::MatrixXd points(const Eigen::MatrixXd& states) const;
    /// The columns of section points among the model's n.
    [[nodiscard]] Eigen::MatrixXd directions(const Eigen::MatrixXd& by_state) const;

    /// a - b of section points, angle coordinates wrapped to (-pi, pi]; shapes (n, m).
    [[nodiscard]] Eigen::MatrixXd difference(const Eigen::MatrixXd& a, const Eigen::MatrixXd& b) const;

private:
    [[nodiscard]] std::optional<SectionImage> crossing(const Eigen::VectorXd& x, const Eigen::VectorXd& theta,
                                                       std::span<const Eigen::Index> free, bool derivatives) const;

    const models::System* system_;
    SectionPlace place_;
    models::FlowOptions flow_;
    Eigen::Index normal_ = -1;        ///< the plane's coordinate; -1: no plane
    double value_ = 0.0;              ///< its value there
    std::vector<Eigen::Index> kept_;  ///< the model's coordinates of section points
    std::vector<models::Coordinate> coordinates_;
};

/// a - b with angle coordinates wrapped to (-pi, pi]; shapes (n, m).
[[nodiscard]] Eigen::MatrixXd wrapped_difference(const models::System& system, const Eigen::MatrixXd& a,
                                                 const Eigen::MatrixXd& b);

/// Whether every parameter lies in its domain, so that a flow may be computed.
[[nodiscard]] bool in_domain(const models::System& system, const Eigen::VectorXd& theta);

}  // namespace orbid::orbits

#pragma GCC visibility pop
