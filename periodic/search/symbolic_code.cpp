#include "periodic/search/symbolic_code.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <numbers>
#include <set>
#include <stdexcept>

#include "periodic/orbit/eigen_names.hpp"

namespace orbid::periodic {

namespace {

void require_partition(bool holds, const std::string& message) {
    if (!holds) throw std::invalid_argument("symbol partition: " + message);
}

}  // namespace

SymbolPartition quarter_turn_partition(Index angle, Index velocity, const std::vector<double>& bands) {
    constexpr double eighth = std::numbers::pi / 4.0;
    constexpr std::size_t first = '!';  // 94 printable characters follow
    require_partition(!bands.empty() && bands.size() <= 22, "one to 22 velocities part the bands of a pendulum");
    SymbolPartition partition;
    partition.cuts = {{angle, {-3.0 * eighth, -eighth, eighth, 3.0 * eighth}}, {velocity, bands}};
    const std::size_t width = bands.size() + 1;
    for (std::size_t k = 0; k < 5 * width; ++k)
        partition.symbols.push_back(static_cast<char>(first + k % (4 * width)));  // the fifth part is the first one
    return partition;
}

void validate(const SymbolPartition& partition, Index dimension) {
    require_partition(!partition.cuts.empty(), "cuts must not be empty");
    std::size_t parts = 1;
    std::set<Index> coordinates;
    for (const SymbolPartition::Cut& cut : partition.cuts) {
        require_partition(
            cut.coordinate >= 0 && cut.coordinate < dimension,
            "coordinate " + std::to_string(cut.coordinate) + " is not in [0, " + std::to_string(dimension) + ")");
        require_partition(coordinates.insert(cut.coordinate).second,
                          "coordinate " + std::to_string(cut.coordinate) + " is cut twice");
        require_partition(!cut.boundaries.empty(), "a cut needs a boundary");
        for (std::size_t i = 0; i < cut.boundaries.size(); ++i)
            require_partition(std::isfinite(cut.boundaries[i]) && (i == 0 || cut.boundaries[i - 1] < cut.boundaries[i]),
                              "boundaries must be finite and ascending");
        parts *= cut.boundaries.size() + 1;
    }
    require_partition(partition.symbols.size() == parts, std::to_string(parts) + " parts need as many symbols, got " +
                                                             std::to_string(partition.symbols.size()));
}

char symbol_of(const SymbolPartition& partition, Eigen::Ref<const VectorXd> x) {
    std::size_t part = 0;
    for (const SymbolPartition::Cut& cut : partition.cuts) {
        const auto above = std::upper_bound(cut.boundaries.begin(), cut.boundaries.end(), x(cut.coordinate));
        part = part * (cut.boundaries.size() + 1) + static_cast<std::size_t>(above - cut.boundaries.begin());
    }
    return partition.symbols[part];
}

std::string symbolic_code(const SymbolPartition& partition, const MatrixXd& points) {
    std::string code;
    for (Index j = 0; j < points.cols(); ++j)
        code.push_back(symbol_of(partition, points.col(j)));
    return code;
}

bool same_cyclic_word(const std::string& a, const std::string& b) {
    return a.size() == b.size() && (a + a).find(b) != std::string::npos;
}

bool is_prime_word(const std::string& word) {
    return !word.empty() && (word + word).find(word, 1) == word.size();
}

}  // namespace orbid::periodic
