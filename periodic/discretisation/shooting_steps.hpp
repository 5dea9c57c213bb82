#pragma once

#include <span>
#include <vector>

#include "models/system/system.hpp"
#include "periodic/discretisation/closing_error.hpp"
#include "periodic/discretisation/discretisation.hpp"
#include "periodic/orbit/eigen_names.hpp"
#include "periodic/orbit/shooting_mesh.hpp"
#include "periodic/orbit/solver_options.hpp"

namespace orbid::periodic {

/// The flow over the segments of a mesh: the steps of multiple shooting. T of autonomous flows is divided among the
/// segments as in the mesh. System and theta are held by reference.
class FlowSteps final : public Discretisation {
public:
    FlowSteps(const models::System& system, const VectorXd& theta, const ShootingMesh& mesh,
              const models::FlowOptions& options);

    [[nodiscard]] StepImage advance(Index j, const VectorXd& z, double time,
                                    std::span<const Index> free) const override;
    /// Segments of equal length are followed in one block.
    [[nodiscard]] std::vector<StepImage> advance_all(const MatrixXd& nodes, double time, std::span<const Index> free,
                                                     std::span<const int> pieces) const override;
    /// If the largest singular value of a Jacobian is g times the smallest, the small multipliers have lost as many
    /// digits as g has.
    [[nodiscard]] std::vector<int> pieces(const std::vector<MatrixXd>& jacobians) const override;

private:
    [[nodiscard]] double duration(const Segment& segment, double time) const {
        return unknown_time() ? segment.share * time : segment.duration;
    }
    [[nodiscard]] StepImage in_pieces(Index j, const VectorXd& z, double time, std::span<const Index> free,
                                      int pieces) const;
    /// The images of one block of flows for each piece.
    [[nodiscard]] std::vector<StepImage> in_blocks(const MatrixXd& nodes, double duration, std::span<const Index> free,
                                                   int pieces) const;
    /// By T, from the image's value. @param duration  of the whole step.
    void add_slope(StepImage& image, double duration) const;

    const models::System& system_;
    const VectorXd& theta_;
    models::Clock clock_;
    std::vector<Segment> segments_;
    models::FlowOptions options_;
};

/// Errors grow too much over a segment with one of these Jacobians, so that the mesh needs further nodes.
[[nodiscard]] bool grows_too_much(const models::System& system, const std::vector<MatrixXd>& jacobians,
                                  const ShootingOptions& options);

/// The closing error at the nodes of a mesh, whole turns not taken off. The mesh gets further nodes first where errors
/// grow too much.
[[nodiscard]] ClosingError refine_and_close(const models::System& system, const VectorXd& theta, ShootingMesh& mesh,
                                            const ShootingOptions& options);

}  // namespace orbid::periodic
