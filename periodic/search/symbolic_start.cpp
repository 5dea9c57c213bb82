#include "periodic/search/symbolic_start.hpp"

#include <algorithm>
#include <cstddef>
#include <limits>
#include <stdexcept>
#include <tuple>
#include <utility>

#include "periodic/solution/multiple_shooting.hpp"

namespace orbid::periodic {
namespace {

/// Symbols compared on either side: the distance has then shrunk to rounding by any expansion above 2.
constexpr int farthest = 48;

/// Where a word was met in an itinerary.
struct Match {
    int ahead = 0;   ///< symbols from this one on
    int behind = 0;  ///< before it
    std::size_t piece = 0;
    std::size_t column = 0;

    /// Dissipative systems contract faster than they expand: half as many symbols behind are enough.
    [[nodiscard]] auto rank() const { return std::make_tuple(std::min(ahead, 2 * behind), ahead + behind); }
};

}  // namespace

SymbolicStarts::SymbolicStarts(const ModelSection& section, const SectionPieces& pieces, SymbolPartition partition)
    : section_(section), pieces_(pieces), partition_(std::move(partition)) {
    validate(partition_, section.system.dimension());
    for (const MatrixXd& piece : pieces.pieces)
        itineraries_.push_back(symbolic_code(partition_, piece));
}

MatrixXd SymbolicStarts::start(const std::string& word, std::size_t rank, int& agreement) const {
    const std::size_t p = word.size();
    MatrixXd points(section_.system.dimension(), static_cast<Index>(p));
    agreement = farthest;
    for (std::size_t j = 0; j < p; ++j) {
        std::vector<Match> best;  // by rank, rank + 1 of them at most
        for (std::size_t k = 0; k < itineraries_.size(); ++k) {
            const std::string& seen = itineraries_[k];
            for (std::size_t t = 0; t < seen.size(); ++t) {
                if (seen[t] != word[j]) continue;
                Match match{1, 0, k, t};
                while (match.ahead < farthest && t + static_cast<std::size_t>(match.ahead) < seen.size() &&
                       seen[t + static_cast<std::size_t>(match.ahead)] ==
                           word[(j + static_cast<std::size_t>(match.ahead)) % p])
                    ++match.ahead;
                while (match.behind < farthest && static_cast<std::size_t>(match.behind) < t &&
                       seen[t - 1 - static_cast<std::size_t>(match.behind)] ==
                           word[(j + p * farthest - 1 - static_cast<std::size_t>(match.behind)) % p])
                    ++match.behind;
                const auto place = std::find_if(best.begin(), best.end(),
                                                [&](const Match& other) { return match.rank() > other.rank(); });
                if (place == best.end() && best.size() > rank) continue;
                best.insert(place, match);
                if (best.size() > rank + 1) best.pop_back();
            }
        }
        if (best.empty()) {
            agreement = 0;
            return MatrixXd(section_.system.dimension(), 0);
        }
        const Match& match = best.back();
        agreement = std::min(agreement, match.ahead);
        points.col(static_cast<Index>(j)) = pieces_.pieces[match.piece].col(static_cast<Index>(match.column));
    }
    return points;
}

CodedOrbit SymbolicStarts::solve(const std::string& word, const ShootingOptions& options, std::size_t tries) const {
    if (!is_prime_word(word))
        throw std::invalid_argument("orbit from code: \"" + word + "\" is empty or repeats a shorter word");
    for (const char symbol : word)
        if (partition_.symbols.find(symbol) == std::string::npos)
            throw std::invalid_argument("orbit from code: symbol '" + std::string(1, symbol) + "' is not among \"" +
                                        partition_.symbols + "\"");
    CodedOrbit result;
    ShootingOptions shooting = options;
    shooting.maximum_distance = std::numeric_limits<double>::infinity();
    if (shooting.scale.size() == 0) shooting.scale = pieces_.size;
    for (std::size_t rank = 0; rank < tries && !result.found; ++rank) {
        int agreement = 0;
        const StartingSolution start = section_.start(this->start(word, rank, agreement));
        if (rank == 0) result.agreement = agreement;
        if (start.points.cols() == 0) break;
        result.orbit = solve_multiple_shooting(section_.system, section_.theta, start, {}, shooting);
        if (result.orbit.status != OrbitStatus::converged) continue;
        result.code = symbolic_code(partition_, result.orbit.points);
        result.found = same_cyclic_word(result.code, word);
    }
    return result;
}

}  // namespace orbid::periodic
