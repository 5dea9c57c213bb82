#pragma once

#include <span>
#include <utility>
#include <vector>

#include "periodic/discretisation/discretisation.hpp"
#include "periodic/discretisation/gauss_method.hpp"
#include "periodic/discretisation/orbit_field.hpp"
#include "periodic/orbit/eigen_names.hpp"

namespace orbid::periodic {

/// Collocation at Gauss points, one polynomial of degree m per interval of the mesh, as one-step maps between the mesh
/// points. x(s_j + c_i h_j) satisfies the equations at all m points. Newton's method solves for the stages within the
/// interval. Collocation codes do the same in their linear algebra as condensation of parameters.
class GaussSteps final : public Discretisation {
public:
    /// @param mesh  ascending shares of the orbit, the first one 0, all below 1.
    GaussSteps(const OrbitField& field, const GaussMethod& method, std::vector<double> mesh)
        : Discretisation(std::move(mesh), field.dimension(), field.autonomous()), field_(field), method_(method) {}

    [[nodiscard]] double width(Index j) const;
    [[nodiscard]] StepImage advance(Index j, const VectorXd& z, double time,
                                    std::span<const Index> free) const override;

    /// dx/ds at the collocation points of an interval, shape (n, m); empty when the equations cannot be solved.
    [[nodiscard]] MatrixXd slopes(Index j, const VectorXd& z, double time) const;

private:
    /// Collocation points of interval j as shares.
    [[nodiscard]] std::vector<double> instants(Index j) const;
    [[nodiscard]] MatrixXd states(Index j, const VectorXd& z, const MatrixXd& slopes) const;
    /// 1 - h a_il J_i, shape (n m, n m).
    [[nodiscard]] MatrixXd matrix(Index j, const MatrixXd& by_state) const;

    const OrbitField& field_;
    const GaussMethod& method_;
};

}  // namespace orbid::periodic
