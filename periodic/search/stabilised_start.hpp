#pragma once

#include <optional>
#include <vector>

#include "periodic/orbit/eigen_names.hpp"
#include "periodic/search/model_section.hpp"

namespace orbid::periodic {

/// p returns to the section: the image and its derivative, in coordinates u along the section that are of order one.
struct SectionReturn {
    bool simulated = false;  ///< everything else is meaningful only if so
    VectorXd gap;            ///< shape (d): u(f^p(x)) - u(x), angles in one turn
    MatrixXd jacobian;       ///< shape (d, d): of f^p
    MatrixXd points;         ///< shape (n, p): x, f(x), ..., angles in (-pi, pi]
};

/// Coordinates along the section, x = D B u: D = diag(size), B orthonormal; d = n, or n - 1 on a plane.
class SectionChart {
public:
    SectionChart(const ModelSection& section, VectorXd size);

    [[nodiscard]] Index dimension() const { return basis_.cols(); }
    [[nodiscard]] VectorXd moved(const VectorXd& x, const VectorXd& by) const;
    [[nodiscard]] SectionReturn returned(const VectorXd& x, int period, const models::FlowOptions& flow) const;

private:
    const ModelSection& section_;
    VectorXd size_;
    std::vector<Index> angles_;
    MatrixXd basis_;  ///< shape (n, d)
};

/// Orthogonal matrices C, at least one of which makes a fixed point of f^p stable under u' = C g(u), g = f^p(u) - u.
///
/// d = 2: the three of {1, diag(1, -1), diag(-1, 1)} suffice for every saddle. With G = dg/du: det G > 0 when the
/// unstable multiplier is negative; both eigenvalues of G are then negative. det G < 0 when it is positive; one of the
/// two reflections then makes det(C G) > 0 and trace(C G) < 0 unless G_11 = G_22. Otherwise: all signed permutation
/// matrices (d <= 3, 2^d d! of them), the diagonal ones of these (d <= 6), or 1 and -1.
[[nodiscard]] std::vector<MatrixXd> stabilising_matrices(Index dimension);

struct StabilisedOptions {
    double beta = 30.0;  ///< steps are no longer than 1 / beta of the section far from an orbit; > 0
    int maximum_iterations = 100;
    double closed = 1e-4;  ///< |g| at which Newton's method may take over
    models::FlowOptions flow{};
};

/// A point of an orbit of period p, to `closed`, by steps of the stabilised flow u' = C g(u)
///
///     u <- u + (beta |g| C^T - G)^-1 g,
///
/// which are Newton's near the orbit and follow that flow far from it.
/// @return the p points; none when it does not arrive.
/// Source: R. L. Davidchack and Y.-C. Lai, Phys. Rev. E 60, 6172 (1999).
[[nodiscard]] std::optional<MatrixXd> stabilised_start(const SectionChart& chart, const VectorXd& from, int period,
                                                       const MatrixXd& c, const StabilisedOptions& options);

}  // namespace orbid::periodic
