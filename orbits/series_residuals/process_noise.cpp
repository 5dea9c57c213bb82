#include "orbits/series_residuals/process_noise.hpp"

#include <algorithm>
#include <cmath>

#include <fmt/format.h>

namespace orbid::orbits {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

namespace {

constexpr Index none = -1;

/// The coordinate of which each one is the integral; none where noise enters.
std::vector<Index> derivatives_of(const MatrixXd& states, const MatrixXd& rates) {
    const Index n = states.rows();
    std::vector<Index> derivative(static_cast<std::size_t>(n), none);
    std::vector<char> taken(static_cast<std::size_t>(n), 0);
    for (Index i = 0; i < n; ++i)
        for (Index j = 0; j < n && derivative[static_cast<std::size_t>(i)] == none; ++j) {
            if (i == j || taken[static_cast<std::size_t>(j)] != 0) continue;
            if (!(rates.row(i).array() == states.row(j).array()).all()) continue;
            // In a ring there is no first one.
            Index end = j;
            while (end != i && derivative[static_cast<std::size_t>(end)] != none)
                end = derivative[static_cast<std::size_t>(end)];
            if (end == i) continue;
            derivative[static_cast<std::size_t>(i)] = j;
            taken[static_cast<std::size_t>(j)] = 1;
        }
    return derivative;
}

}  // namespace

std::vector<NoiseChain> noise_chains(const models::System& system, const MatrixXd& states,
                                     const std::vector<double>& phases, const VectorXd& theta) {
    const std::vector<Index> derivative = derivatives_of(states, system.rhs(states, phases, theta));
    std::vector<NoiseChain> chains;
    for (Index first = 0; first < states.rows(); ++first) {
        if (derivative[static_cast<std::size_t>(first)] != none) continue;
        NoiseChain& chain = chains.emplace_back();
        for (Index next = first; next != none;) {
            chain.coordinates.push_back(next);
            const auto integral = std::find(derivative.begin(), derivative.end(), next);
            next = integral == derivative.end() ? none : integral - derivative.begin();
        }
    }
    return chains;
}

LinkErrors link_errors(const std::vector<NoiseChain>& chains, double duration) {
    Index n = 0;
    for (const NoiseChain& chain : chains)
        n += std::ssize(chain.coordinates);
    LinkErrors result{MatrixXd::Identity(n, n), VectorXd::Ones(n)};
    for (const NoiseChain& chain : chains) {
        const auto m = std::ssize(chain.coordinates);
        // cov = T S H S with S = diag(T^i / i!) and Hilbert's matrix H = L D L^T.
        VectorXd scale = VectorXd::Ones(m);
        for (Index i = 1; i < m; ++i)
            scale[i] = scale[i - 1] * duration / static_cast<double>(i);
        MatrixXd lower = MatrixXd::Identity(m, m);
        VectorXd pivot = VectorXd::Zero(m);
        for (Index j = 0; j < m; ++j)
            for (Index i = j; i < m; ++i) {
                double rest = 1.0 / static_cast<double>(i + j + 1);
                for (Index k = 0; k < j; ++k)
                    rest -= lower(i, k) * pivot[k] * lower(j, k);
                if (i == j)
                    pivot[j] = rest;
                else
                    lower(i, j) = rest / pivot[j];
            }
        // Rows of the inverse of S L S^-1, from the first on.
        MatrixXd inverse = MatrixXd::Identity(m, m);
        for (Index i = 0; i < m; ++i)
            for (Index k = 0; k < i; ++k)
                inverse.row(i) -= scale[i] * lower(i, k) / scale[k] * inverse.row(k);
        for (Index i = 0; i < m; ++i) {
            const Index row = chain.coordinates[static_cast<std::size_t>(i)];
            for (Index k = 0; k < i; ++k)
                result.unmix(row, chain.coordinates[static_cast<std::size_t>(k)]) = inverse(i, k);
            result.deviation[row] = scale[i] * std::sqrt(duration * pivot[i]);
        }
    }
    return result;
}

std::string diffusion_unit(std::string_view unit) {
    if (unit.empty() || unit == "1") return "1/s";
    const bool simple = unit.find_first_of("/*^ ") == std::string_view::npos;
    return simple ? fmt::format("{}^2/s", unit) : fmt::format("({})^2/s", unit);
}

std::string root_diffusion_unit(std::string_view unit) {
    return fmt::format("{}/sqrt(s)", unit.empty() ? "1" : unit);
}

}  // namespace orbid::orbits
