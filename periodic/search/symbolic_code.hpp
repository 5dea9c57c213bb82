#pragma once

#include <string>
#include <vector>

#include <Eigen/Core>

#include "models/arithmetic/matrix_layout.hpp"

#pragma GCC visibility push(default)

namespace orbid::periodic {

/// Divides a section into named parts, so that an orbit has a symbolic code.
struct SymbolPartition {
    struct Cut {
        Eigen::Index coordinate = 0;
        std::vector<double> boundaries;  ///< [coordinate's unit], ascending, one at least
    };
    std::vector<Cut> cuts;  ///< one at least, of different coordinates
    /// One character per part: parts of the first cut from below. With a second cut, all of its parts for the first
    /// part of the first one, and so on. Parts may share one: those on either side of -pi = pi should.
    std::string symbols;
};

/// Partition of the section of a pendulum: four quarters of the turn, centred on hanging, standing and the two sides,
/// times bands of the velocity. It is its own mirror image. Bands -10, -6, -2, 2, 6, 10 rad/s distinguish all 493
/// orbits of periods 1 to 5 of the parametrically excited pendulum (g = 9.81, k1 = 0). With -9, -3, 3, 9 two pairs of
/// period 5 share a word, and two orbits of period 4 have words that repeat. Turns per period alone: 33 words for the
/// 352 orbits of period 5, up to 54 of them with one word.
/// @param bands  [rad/s], ascending, one to 22 of them.
/// @throws std::invalid_argument on other numbers of them
[[nodiscard]] SymbolPartition quarter_turn_partition(Eigen::Index angle, Eigen::Index velocity,
                                                     const std::vector<double>& bands);

/// @throws std::invalid_argument naming the rule broken.
void validate(const SymbolPartition& partition, Eigen::Index dimension);

[[nodiscard]] char symbol_of(const SymbolPartition& partition, Eigen::Ref<const Eigen::VectorXd> x);

/// One symbol per point. Shape of points (n, p).
[[nodiscard]] std::string symbolic_code(const SymbolPartition& partition, const Eigen::MatrixXd& points);

/// The same cyclic word, whatever its first symbol.
[[nodiscard]] bool same_cyclic_word(const std::string& a, const std::string& b);

/// The word does not repeat a shorter one.
[[nodiscard]] bool is_prime_word(const std::string& word);

}  // namespace orbid::periodic

#pragma GCC visibility pop
