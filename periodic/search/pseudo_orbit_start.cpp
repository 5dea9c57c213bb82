#include "periodic/search/pseudo_orbit_start.hpp"

#include <algorithm>
#include <limits>
#include <tuple>
#include <utility>

#include "periodic/orbit/winding_number.hpp"

namespace orbid::periodic {
namespace {

/// Steps from one cell to another that are compared for a loop; others are left out evenly.
constexpr std::size_t compared = 16;

}  // namespace

PseudoOrbits::PseudoOrbits(const SectionPieces& pieces, const SectionCells& cells, std::vector<Index> angles)
    : pieces_(pieces), angles_(std::move(angles)) {
    struct NamedStep {
        std::uint64_t from, to;
        SeenStep step;
    };
    std::vector<NamedStep> seen;
    std::vector<std::pair<std::uint64_t, std::uint64_t>> named;
    for (std::size_t k = 0; k < pieces.pieces.size(); ++k) {
        const MatrixXd& piece = pieces.pieces[k];
        std::uint64_t from = 0;
        for (Index t = 0; t < piece.cols(); ++t) {
            const std::uint64_t to = cells.name(piece.col(t));
            named.emplace_back(to, cells.mirrored(piece.col(t)));
            if (t > 0) seen.push_back({from, to, {static_cast<std::uint32_t>(k), static_cast<std::uint32_t>(t - 1)}});
            from = to;
        }
    }
    std::sort(named.begin(), named.end());
    named.erase(
        std::unique(named.begin(), named.end(), [](const auto& a, const auto& b) { return a.first == b.first; }),
        named.end());
    for (const auto& [name, mirror] : named) {
        names_.push_back(name);
        mirrored_.push_back(mirror);
    }
    std::stable_sort(seen.begin(), seen.end(),
                     [](const auto& a, const auto& b) { return std::tie(a.from, a.to) < std::tie(b.from, b.to); });
    steps_.resize(names_.size());
    const auto index = [&](std::uint64_t name) {
        return static_cast<std::uint32_t>(std::lower_bound(names_.begin(), names_.end(), name) - names_.begin());
    };
    for (std::size_t i = 0; i < seen.size(); ++i) {
        seen_.push_back(seen[i].step);
        if (i == 0 || seen[i].from != seen[i - 1].from || seen[i].to != seen[i - 1].to)
            steps_[index(seen[i].from)].push_back({index(seen[i].to), i, i});
        ++steps_[index(seen[i].from)].back().end;
    }
}

std::optional<std::vector<std::vector<std::uint32_t>>> PseudoOrbits::loops(int period, std::size_t most) const {
    using Loop = std::vector<std::uint32_t>;
    const std::size_t cells = names_.size();
    std::vector<std::vector<std::uint32_t>> sources(cells);
    for (std::uint32_t from = 0; from < cells; ++from)
        for (const Step& step : steps_[from])
            sources[step.to].push_back(from);
    std::vector<std::pair<std::uint64_t, Loop>> found;
    std::vector<int> distance(cells);
    for (std::uint32_t first = 0; first < cells; ++first) {
        // Number of steps from each cell to the first one, through cells that are not before it: every loop is found
        // from its smallest cell.
        std::fill(distance.begin(), distance.end(), period + 1);
        std::vector<std::uint32_t> front{first}, next;
        for (int steps = 1; steps <= period && !front.empty(); ++steps, front.swap(next)) {
            next.clear();
            for (const std::uint32_t cell : front)
                for (const std::uint32_t source : sources[cell])
                    if (source >= first && distance[source] > steps) {
                        distance[source] = steps;
                        next.push_back(source);
                    }
        }
        if (distance[first] > period) continue;
        Loop loop{first};
        std::vector<std::size_t> choice{0};
        while (!loop.empty()) {
            const auto& steps = steps_[loop.back()];
            const int left = period - static_cast<int>(loop.size());
            if (choice.back() == steps.size()) {
                loop.pop_back();
                choice.pop_back();
                continue;
            }
            const std::uint32_t to = steps[choice.back()++].to;
            if (left == 0) {
                if (to != first) continue;
                std::vector<std::uint64_t> symbols, mirrored;
                for (const std::uint32_t cell : loop) {
                    symbols.push_back(names_[cell]);
                    mirrored.push_back(mirrored_[cell]);
                }
                found.emplace_back(std::min(cyclic_name(symbols.data(), symbols.size()),
                                            cyclic_name(mirrored.data(), mirrored.size())),
                                   loop);
                if (found.size() > 2 * static_cast<std::size_t>(period) * most) return std::nullopt;
            } else if (to >= first && distance[to] <= left) {
                loop.push_back(to);
                choice.push_back(0);
            }
        }
    }
    std::sort(found.begin(), found.end());
    std::vector<Loop> result;
    for (std::size_t i = 0; i < found.size(); ++i)
        if (i == 0 || found[i].first != found[i - 1].first) result.push_back(std::move(found[i].second));
    if (result.size() > most) return std::nullopt;
    return result;
}

std::vector<PseudoOrbits::SeenStep> PseudoOrbits::candidates(std::uint32_t from, std::uint32_t to) const {
    const auto& steps = steps_[from];
    const auto step =
        std::lower_bound(steps.begin(), steps.end(), to, [](const Step& s, std::uint32_t t) { return s.to < t; });
    const std::size_t count = step->end - step->begin, used = std::min(count, compared);
    std::vector<SeenStep> result;
    for (std::size_t k = 0; k < used; ++k)
        result.push_back(seen_[step->begin + k * count / used]);
    return result;
}

MatrixXd PseudoOrbits::jumps(const std::vector<SeenStep>& steps, const std::vector<SeenStep>& next) const {
    MatrixXd squares(steps.size(), next.size());
    for (Index a = 0; a < squares.rows(); ++a)
        for (Index b = 0; b < squares.cols(); ++b) {
            const VectorXd jump =
                state(next[static_cast<std::size_t>(b)], 0) - state(steps[static_cast<std::size_t>(a)], 1);
            squares(a, b) = wrapped_angles(jump, angles_).cwiseQuotient(pieces_.size).squaredNorm();
        }
    return squares;
}

std::vector<MatrixXd> PseudoOrbits::starts(const std::vector<std::uint32_t>& loop, std::size_t most) const {
    const std::size_t p = loop.size();
    std::vector<std::vector<SeenStep>> choices;
    std::vector<MatrixXd> squares;
    for (std::size_t j = 0; j < p; ++j)
        choices.push_back(candidates(loop[j], loop[(j + 1) % p]));
    for (std::size_t j = 0; j < p; ++j)
        squares.push_back(jumps(choices[j], choices[(j + 1) % p]));
    std::vector<std::pair<double, MatrixXd>> found;
    for (Index first = 0; first < squares[0].rows(); ++first) {
        // Dynamic programming (Bellman) around the loop: least sums from the first choice to each of the next cell's.
        VectorXd sums = squares[0].row(first);
        std::vector<std::vector<Index>> from(p);
        for (std::size_t j = 1; j < p; ++j) {
            VectorXd next(squares[j].cols());
            from[j].resize(static_cast<std::size_t>(next.size()));
            for (Index b = 0; b < next.size(); ++b)
                next(b) = (sums + squares[j].col(b)).minCoeff(&from[j][static_cast<std::size_t>(b)]);
            sums = std::move(next);
        }
        MatrixXd points(pieces_.size.size(), static_cast<Index>(p));
        Index choice = first;
        for (std::size_t j = p; j-- > 0;) {
            choice = j == 0 ? first : from[j][static_cast<std::size_t>(choice)];
            points.col(static_cast<Index>(j)) = state(choices[j][static_cast<std::size_t>(choice)], 0);
        }
        found.emplace_back(sums(first), std::move(points));
    }
    std::stable_sort(found.begin(), found.end(), [](const auto& a, const auto& b) { return a.first < b.first; });
    std::vector<MatrixXd> result;
    for (std::size_t k = 0; k < std::min(most, found.size()); ++k)
        result.push_back(std::move(found[k].second));
    return result;
}

}  // namespace orbid::periodic
