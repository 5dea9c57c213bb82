#pragma once

#include <vector>

#include <Eigen/Core>

namespace orbid::estimator {

/// Rows of one block of a stacked least-squares problem: [A_z | A | w], columns of its own latent states first, then
/// those of the common parameters, then the right-hand side.
struct BlockTriangle {
    Eigen::Index latents = 0;
    /// Upper trapezoid of the orthogonal factorisation, shape (latents + q + 1, latents + q + 1).
    Eigen::MatrixXd triangle;
    Eigen::VectorXd norm;    ///< Euclidean norms of the latent columns, shape (latents)
    std::vector<bool> dead;  ///< latent states the block says nothing about (given the earlier ones): they stay put
};

/// The stacked problem min_{d, d_z} sum_b ||A_z,b d_z,b + A_b d + w_b||^2 with an arrow structure, by orthogonal
/// factorisation of each block: no normal equations, cost linear in the blocks.
struct Arrow {
    Eigen::Index parameters = 0;
    std::vector<BlockTriangle> blocks;
    Eigen::MatrixXd pool;  ///< triangle of all rows below the latent ones, shape (q + 1, q + 1)
};

/// What is left for the parameters after the latent states took their best values (Schur complement), with the latent
/// steps damped by mu ||D_z d_z||^2, D_z = column norms.
struct Condensed {
    std::vector<Eigen::MatrixXd> top;  ///< per block [R_zz | R_z | r_z], shape (latents, latents + q + 1)
    Eigen::MatrixXd r;                 ///< upper triangle, shape (q, q)
    Eigen::VectorXd rhs;               ///< shape (q): minimise ||r d + rhs||^2
    double rest = 0.0;                 ///< ||.|| that no step can remove
};

/// Upper trapezoid R of a = Q R, shape (columns, columns), padded with zero rows. Heavy rows go first.
[[nodiscard]] Eigen::MatrixXd upper_triangle(Eigen::MatrixXd a);

/// Factorises one block's rows [A_z | A | w] (any number of rows).
[[nodiscard]] BlockTriangle block_triangle(Eigen::MatrixXd rows, Eigen::Index latents);

[[nodiscard]] Arrow factorise(std::vector<BlockTriangle> blocks, Eigen::Index parameters);

[[nodiscard]] Condensed condense(const Arrow& arrow, double mu);

/// The latent steps that belong to the parameter step d: R_zz d_z = -(r_z + R_z d). One vector per block.
[[nodiscard]] std::vector<Eigen::VectorXd> latent_steps(const Arrow& arrow, const Condensed& condensed,
                                                        const Eigen::VectorXd& d);

/// Change of 1/2 ||A d + w||^2 by a step, and ||A d||^2, without cancellation.
struct ModelChange {
    double linear = 0.0;     ///< w^T A d
    double quadratic = 0.0;  ///< ||A d||^2
};
[[nodiscard]] ModelChange model_change(const Arrow& arrow, const Eigen::VectorXd& d,
                                       const std::vector<Eigen::VectorXd>& d_z);

}  // namespace orbid::estimator
