#include "periodic/stability/floquet_vector.hpp"

#include <cmath>
#include <cstddef>

#include "periodic/discretisation/cyclic_system.hpp"

namespace orbid::periodic {
namespace {

using Complex = std::complex<double>;
using Eigen::MatrixXcd;

/// Multiplication by a complex number times a real matrix, on (real part, imaginary part) below each other.
MatrixXd real_form(const MatrixXd& factor, Complex number) {
    const Index n = factor.rows();
    MatrixXd whole(2 * n, 2 * n);
    whole << number.real() * factor, -number.imag() * factor, number.imag() * factor, number.real() * factor;
    return whole;
}

/// Null vector of v_{j+1} - c_j X_j v_j on a circle, shape (n, p).
MatrixXcd null_vector(const std::vector<MatrixXd>& factors, const std::vector<Complex>& scale) {
    const Index n = factors.front().rows();
    const auto p = static_cast<Index>(factors.size());
    bool real = true;
    for (const Complex& c : scale)
        real = real && c.imag() == 0.0;
    std::vector<MatrixXd> scaled;
    for (std::size_t j = 0; j < factors.size(); ++j)
        scaled.push_back(real ? MatrixXd(scale[j].real() * factors[j]) : real_form(factors[j], scale[j]));
    const MatrixXd columns = CyclicSystem(scaled).null_vector().reshaped(real ? n : 2 * n, p);
    MatrixXcd result(n, p);
    result.real() = columns.topRows(n);
    if (real)
        result.imag().setZero();
    else
        result.imag() = columns.bottomRows(n);
    return result;
}

}  // namespace

FloquetVectors floquet_vectors(const std::vector<MatrixXd>& factors, Complex multiplier) {
    const std::size_t p = factors.size();
    const double root = std::pow(std::abs(multiplier), 1.0 / static_cast<double>(p));
    FloquetVectors vectors;
    std::vector<Complex> scale;
    for (std::size_t j = 0; j < p; ++j) {
        Complex rho = root;
        if (j == 0 && multiplier.imag() == 0.0)
            rho = std::copysign(root, multiplier.real());
        else if (j == 0)
            rho = root * (multiplier / std::abs(multiplier));
        vectors.rho.push_back(rho);
        scale.push_back(1.0 / rho);
    }
    vectors.right = null_vector(factors, scale);
    // w_j^T = w_{j+1}^T X_j / rho_j runs backwards: u_i = w_{p-i}.
    std::vector<MatrixXd> transposed;
    std::vector<Complex> backwards;
    for (std::size_t i = 0; i < p; ++i) {
        transposed.push_back(factors[p - 1 - i].transpose());
        backwards.push_back(scale[p - 1 - i]);
    }
    const MatrixXcd u = null_vector(transposed, backwards);
    vectors.left.resize(u.rows(), u.cols());
    for (std::size_t j = 0; j < p; ++j)
        vectors.left.col(static_cast<Index>(j)) = u.col(static_cast<Index>((p - j) % p));
    return vectors;
}

}  // namespace orbid::periodic
