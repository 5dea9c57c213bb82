#include "periodic/search/recurrence_start.hpp"

#include <algorithm>
#include <cmath>
#include <cstdint>

#include "periodic/orbit/winding_number.hpp"
#include "periodic/search/section_cell.hpp"

namespace orbid::periodic {
namespace {

struct Candidate {
    std::uint64_t itinerary;
    RecurrenceStart start;
};

}  // namespace

std::vector<RecurrenceStart> recurrence_starts(const models::System& system, const SectionPieces& pieces, int period,
                                               double box, double cell, const std::vector<double>& signs) {
    const SectionCells cells(system, pieces.size, cell, signs);
    const auto p = static_cast<std::size_t>(period);
    const Index n = system.dimension();
    std::vector<bool> angle(static_cast<std::size_t>(n), false);
    for (const Index i : angle_coordinates(system))
        angle[static_cast<std::size_t>(i)] = true;
    std::vector<Candidate> candidates;
    std::vector<std::uint64_t> names, mirrored;
    for (std::size_t k = 0; k < pieces.pieces.size(); ++k) {
        const MatrixXd& piece = pieces.pieces[k];
        if (piece.cols() <= period) continue;
        names.resize(static_cast<std::size_t>(piece.cols()));
        mirrored.resize(signs.empty() ? 0 : names.size());
        for (std::size_t t = 0; t < names.size(); ++t) {
            names[t] = cells.name(piece.col(static_cast<Index>(t)));
            if (!signs.empty()) mirrored[t] = cells.mirrored(piece.col(static_cast<Index>(t)));
        }
        for (Index t = 0; t + period < piece.cols(); ++t) {
            double gap = 0.0;
            for (Index i = 0; i < n; ++i) {
                double move = piece(i, t + period) - piece(i, t);
                if (angle[static_cast<std::size_t>(i)]) move = models::wrapped(move);
                gap = std::max(gap, std::abs(move) / pieces.size(i));
            }
            if (!(gap <= box)) continue;
            std::uint64_t itinerary = cyclic_name(names.data() + t, p);
            if (!signs.empty()) itinerary = std::min(itinerary, cyclic_name(mirrored.data() + t, p));
            candidates.push_back({itinerary, {k, t, gap}});
        }
    }
    std::stable_sort(candidates.begin(), candidates.end(), [](const Candidate& a, const Candidate& b) {
        return a.itinerary != b.itinerary ? a.itinerary < b.itinerary : a.start.gap < b.start.gap;
    });
    std::vector<RecurrenceStart> starts;
    for (std::size_t i = 0; i < candidates.size(); ++i)
        if (i == 0 || candidates[i].itinerary != candidates[i - 1].itinerary) starts.push_back(candidates[i].start);
    std::sort(starts.begin(), starts.end(), [](const RecurrenceStart& a, const RecurrenceStart& b) {
        if (a.gap != b.gap) return a.gap < b.gap;
        return a.piece != b.piece ? a.piece < b.piece : a.first < b.first;
    });
    return starts;
}

}  // namespace orbid::periodic
