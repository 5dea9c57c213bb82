#pragma once

#include <string>
#include <vector>

#include <Eigen/Core>

namespace orbid::periodic {

/// Cuts a section into named parts, so that an orbit has a symbolic code.
struct SymbolPartition {
    struct Cut {
        Eigen::Index coordinate = 0;
        std::vector<double> boundaries;  ///< [coordinate's unit], ascending, one at least
    };
    std::vector<Cut> cuts;  ///< one at least, of different coordinates
    /// One character per part, all different: parts of the first cut from below; with a second cut all of its parts
    /// for the first part of the first one, and so on.
    std::string symbols;
};

/// @throws std::invalid_argument naming the rule broken.
void validate(const SymbolPartition& partition, Eigen::Index dimension);

[[nodiscard]] char symbol_of(const SymbolPartition& partition, Eigen::Ref<const Eigen::VectorXd> x);

/// One symbol per point. Shape of points (n, p).
[[nodiscard]] std::string symbolic_code(const SymbolPartition& partition, const Eigen::MatrixXd& points);

/// The same cyclic word, whatever its first symbol.
[[nodiscard]] bool same_cyclic_word(const std::string& a, const std::string& b);

/// The word repeats no shorter one.
[[nodiscard]] bool is_prime_word(const std::string& word);

}  // namespace orbid::periodic
