#include "orbits/records/nearest_name.hpp"

#include <algorithm>
#include <cctype>
#include <cstddef>
#include <numeric>

namespace orbid::orbits {
namespace {

bool same_letter(char a, char b) {
    return std::tolower(static_cast<unsigned char>(a)) == std::tolower(static_cast<unsigned char>(b));
}

/// Levenshtein's distance, one row of the table at a time.
std::size_t changes(std::string_view a, std::string_view b) {
    std::vector<std::size_t> row(b.size() + 1);
    std::iota(row.begin(), row.end(), std::size_t{0});
    for (std::size_t i = 0; i < a.size(); ++i) {
        std::size_t diagonal = row[0];
        row[0] = i + 1;
        for (std::size_t j = 0; j < b.size(); ++j) {
            const std::size_t above = row[j + 1];
            row[j + 1] = std::min({above + 1, row[j] + 1, diagonal + (same_letter(a[i], b[j]) ? 0U : 1U)});
            diagonal = above;
        }
    }
    return row.back();
}

}  // namespace

std::optional<std::string> nearest_name(std::string_view name, const std::vector<std::string>& known) {
    const std::size_t allowed = std::max<std::size_t>(name.size() / 3, name.size() >= 4 ? 2 : 1);
    std::size_t best = allowed + 1;
    std::optional<std::string> nearest;
    // What nobody types is no misspelling; the work grows with the square of the length.
    constexpr std::size_t longest = 200;
    if (name.size() > longest) return nearest;
    for (const std::string& candidate : known) {
        const std::size_t difference =
            std::max(name.size(), candidate.size()) - std::min(name.size(), candidate.size());
        if (difference >= best) continue;  // as many changes at least
        const std::size_t distance = changes(name, candidate);
        // A name of which not one letter fits is no misspelling.
        if (distance < best && distance < std::max(name.size(), candidate.size())) {
            best = distance;
            nearest = candidate;
        }
    }
    return nearest;
}

}  // namespace orbid::orbits
