#pragma once

#include <optional>
#include <span>
#include <vector>

#include <Eigen/Core>

#include "models/arithmetic/matrix_layout.hpp"
#include "models/system/system.hpp"

#pragma GCC visibility push(default)

namespace orbid::periodic {

/// What is known of an orbit before it is computed.
///
/// forced models, maps: `points`, one per period of the forcing (iteration), at `phase`.
/// autonomous flows:    `points` on `section`, its successive crossings; or one state in `points` and the period
/// `time`.
struct StartingSolution {
    Eigen::MatrixXd points;     ///< shape (n, p), finite
    std::vector<int> rotation;  ///< turns per orbit, one per angle coordinate; empty: nearest whole turns of the guess
    double phase = 0.0;         ///< of the section [rad] (forced models)
    std::optional<models::Section> section;  ///< autonomous flows
    double time = 0.0;                       ///< T [s], > 0 (autonomous flows without a section)
};

/// A piece of motion from one node to the next.
struct Segment {
    double phase = 0.0;     ///< at its start [rad] (forced models)
    double duration = 0.0;  ///< in units of the clock; autonomous flows: at the first guess of T
    double share = 0.0;     ///< of the whole orbit, in (0, 1]
};

/// A guess of an orbit: nodes, and the pieces of motion that lead from each towards the next.
struct ShootingMesh {
    bool simulated = false;            ///< everything else is meaningful only if so
    models::Clock clock{};             ///< phase for forced models
    Eigen::MatrixXd nodes;             ///< shape (n, N)
    std::vector<Segment> segments;     ///< N
    std::vector<Eigen::Index> points;  ///< which nodes are the points of the starting solution
    double time = 0.0;                 ///< T [s]; iterations of a map

    /// Shares of the orbit at which its segments begin.
    [[nodiscard]] std::vector<double> begins() const;
};

/// |x| / |f|, a time of the motion at a state of an autonomous flow [s]. Near an equilibrium at most 1e6 / |df/dx|.
[[nodiscard]] double motion_time(const models::System& system, const Eigen::VectorXd& theta, const Eigen::VectorXd& x);

/// The mesh through the points themselves, one segment from each to the next. Segments of autonomous flows last as long
/// as the return to the section.
/// @throws std::invalid_argument on wrong shapes, nan, time <= 0, or a start that does not fit the kind of model.
[[nodiscard]] ShootingMesh mesh_from_guess(const models::System& system, const Eigen::VectorXd& theta,
                                           const StartingSolution& start, const models::FlowOptions& options);

/// The same mesh with further nodes, taken from its flow, in segments over which an error grows too much. There the
/// ratio of the largest to the smallest singular value of X exceeds `growth`: the growth of an error forwards times
/// that backwards.
[[nodiscard]] ShootingMesh refined(const models::System& system, const Eigen::VectorXd& theta, const ShootingMesh& mesh,
                                   double growth, const models::FlowOptions& options);

/// The same mesh with nodes at equal times, taken from its flow: `pieces` segments for each.
[[nodiscard]] ShootingMesh split_uniformly(const models::System& system, const Eigen::VectorXd& theta,
                                           const ShootingMesh& mesh, int pieces, const models::FlowOptions& options);

/// That ratio exceeds `growth`. A direction that is lost altogether (sticking) has no growth backwards.
[[nodiscard]] bool grows_beyond(const Eigen::MatrixXd& jacobian, double growth);
/// The number of pieces of even growth, in [1, 48], that keeps each below `growth`.
[[nodiscard]] int pieces_of(const Eigen::MatrixXd& jacobian, double growth);

/// States along a mesh, angles continuous: the whole turns between its nodes are added up.
struct SampledMesh {
    bool simulated = false;  ///< everything else is meaningful only if so
    Eigen::MatrixXd states;  ///< shape (n, shares.size())
    Eigen::VectorXd turns;   ///< shape (n): whole turns of the angles over the whole orbit, nearest to the guess
};

/// @param shares  of the whole orbit, ascending, in [0, 1).
[[nodiscard]] SampledMesh sampled(const models::System& system, const Eigen::VectorXd& theta, const ShootingMesh& mesh,
                                  std::span<const double> shares, const models::FlowOptions& options);

}  // namespace orbid::periodic

#pragma GCC visibility pop
