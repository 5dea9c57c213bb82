#include "periodic/recurrence_start.hpp"

#include <algorithm>
#include <cmath>
#include <cstdint>

#include "periodic/whole_turn.hpp"

namespace orbid::periodic {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;

std::uint64_t mixed(std::uint64_t z) {
    z = (z ^ (z >> 30U)) * 0xbf58476d1ce4e5b9U;
    z = (z ^ (z >> 27U)) * 0x94d049bb133111ebU;
    return z ^ (z >> 31U);
}

/// Name of the cell that a point lies in.
class Cells {
public:
    Cells(const models::System& system, const SectionPieces& pieces, double edge)
        : pieces_(pieces), edge_(edge), angle_(static_cast<std::size_t>(system.dimension()), false) {
        for (const Index i : angle_coordinates(system))
            angle_[static_cast<std::size_t>(i)] = true;
    }

    [[nodiscard]] std::uint64_t operator()(Eigen::Ref<const Eigen::VectorXd> x,
                                           const std::vector<double>& signs) const {
        std::uint64_t name = 0;
        for (Index i = 0; i < x.size(); ++i) {
            const double value = signs.empty() ? x(i) : signs[static_cast<std::size_t>(i)] * x(i);
            const double size = pieces_.size(i);
            // Cells are centred on 0: where a symmetry's fixed points are. Half a turn is the same cell both ways.
            double number = std::floor(value / (edge_ * size) + 0.5);
            if (angle_[static_cast<std::size_t>(i)]) {
                const double around = std::max(2.0, 2.0 * std::floor(0.5 / edge_));
                number = std::floor(value * around / size + 0.5);
                if (2.0 * number >= around) number -= around;
            }
            name = mixed(name * 0x9e3779b97f4a7c15U + static_cast<std::uint64_t>(static_cast<std::int64_t>(number)));
        }
        return name;
    }

private:
    const SectionPieces& pieces_;
    double edge_;
    std::vector<bool> angle_;
};

/// The smallest hash of a sequence over its cyclic shifts.
std::uint64_t cyclic_name(const std::uint64_t* symbols, std::size_t p) {
    std::uint64_t smallest = ~std::uint64_t{0};
    for (std::size_t shift = 0; shift < p; ++shift) {
        std::uint64_t name = 0;
        for (std::size_t j = 0; j < p; ++j)
            name = mixed(name * 0xd1342543de82ef95U + symbols[(j + shift) % p]);
        smallest = std::min(smallest, name);
    }
    return smallest;
}

struct Candidate {
    std::uint64_t itinerary;
    RecurrenceStart start;
};

}  // namespace

std::vector<RecurrenceStart> recurrence_starts(const models::System& system, const SectionPieces& pieces, int period,
                                               double box, double cell, const std::vector<double>& signs) {
    const Cells cells(system, pieces, cell);
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
            names[t] = cells(piece.col(static_cast<Index>(t)), {});
            if (!signs.empty()) mirrored[t] = cells(piece.col(static_cast<Index>(t)), signs);
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
