#include "orbits/cycles/streamed_search.hpp"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <limits>
#include <memory>
#include <optional>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include <fmt/format.h>
#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include "orbits/cycles/cycle_candidate.hpp"
#include "orbits/cycles/cycle_finder.hpp"
#include "orbits/cycles/near_places.hpp"
#include "orbits/sections/neighbour_index.hpp"
#include "orbits/sections/section_points.hpp"

namespace orbid::orbits {

namespace {

// Memory of a search as a multiple of the series' own: three times (points, their grid and the series), and as much
// again for recurrences and fits.
constexpr std::size_t copies = 4;

// Fewer points than this are no record to search.
constexpr std::size_t least_points = 1 << 14;

// Stretches that are searched: many, so that a record which drifts or consists of several trajectories is covered;
// few, so that the disk reads long pieces.
constexpr std::size_t stretches = 16;

// Points with an image that a cycle's point is refined on. Local fits on clean data use 100 of them, on noisy data some
// thousands.
constexpr std::size_t near_points = 4096;

// The radius around a cycle's point is that of at least so many neighbours in the stretches: fewer say little about the
// density.
constexpr std::size_t least_neighbours = 8;

// Points read at once.
constexpr std::size_t block = 1 << 18;

// Partners of a mirror pair lie no farther apart than this part of a box before they count as one.
constexpr double same_boxes = 0.3;

// A cycle found in the stretches, to be refined on the whole record.
struct Start {
    std::size_t cycle = 0;  // in CycleSearch::cycles
    CycleCandidate draft;
    std::vector<double> radii;  // around each point, scaled units
};

Series stretches_of(const SeriesStream& record, std::size_t points) {
    Series series = record.header();
    const std::size_t length = points / stretches, last = record.size() - length;
    for (std::size_t i = 0; i < stretches; ++i) {
        std::vector<Segment> pieces = record.read(i * last / (stretches - 1), length);
        std::move(pieces.begin(), pieces.end(), std::back_inserter(series.segments));
    }
    return series;
}

CycleCandidate draft_of(const SectionPoints& section, const Cycle& cycle) {
    CycleCandidate draft;
    const Eigen::VectorXd unit = section.scale().cwiseInverse().replicate(cycle.period, 1);
    draft.points = section.scale().cwiseInverse().asDiagonal() * cycle.points;
    for (Eigen::Index j = 0; j < draft.points.cols(); ++j)
        draft.points.col(j) = section.wrapped(draft.points.col(j));
    draft.covariance = unit.asDiagonal() * cycle.covariance * unit.asDiagonal();
    draft.recurrences = cycle.recurrences;
    return draft;
}

// One of every mirror pair. `share` of the record was searched.
std::vector<Start> starts_of(const Series& sample, const CycleSearchOptions& options, const CycleSearch& search,
                             double share) {
    const SectionPoints section(sample, options.symmetry_signs, {}, options.interrupted);
    const NeighbourIndex grid(section);
    const std::size_t k =
        std::max(least_neighbours, static_cast<std::size_t>(share * static_cast<double>(near_points)));
    std::vector<Start> starts;
    for (std::size_t i = 0; i < search.cycles.size(); ++i) {
        if (search.cycles[i].mirror && *search.cycles[i].mirror < i) continue;
        Start start{i, draft_of(section, search.cycles[i]), {}};
        for (Eigen::Index j = 0; j < start.draft.points.cols(); ++j)
            start.radii.push_back(std::sqrt(grid.nearest(start.draft.points.col(j), k).back().distance2));
        starts.push_back(std::move(start));
    }
    return starts;
}

NearPlaces places_of(const SeriesStream& record, const CycleSearchOptions& options, const std::vector<Start>& starts,
                     double narrowed) {
    std::vector<double> radii;
    std::vector<Eigen::VectorXd> places;
    for (const Start& start : starts)
        for (Eigen::Index j = 0; j < start.draft.points.cols(); ++j) {
            const double radius =
                std::max(narrowed * start.radii[static_cast<std::size_t>(j)], std::numeric_limits<double>::min());
            places.emplace_back(start.draft.points.col(j));
            radii.push_back(radius);
            if (!options.symmetry_signs) continue;
            // mirrored copies are neighbours, too
            places.emplace_back(Eigen::Map<const Eigen::VectorXd>(options.symmetry_signs->data(), places.back().size())
                                    .cwiseProduct(places.back()));
            radii.push_back(radius);
        }
    Eigen::MatrixXd columns(record.header().dimension(), static_cast<Eigen::Index>(places.size()));
    for (std::size_t i = 0; i < places.size(); ++i)
        columns.col(static_cast<Eigen::Index>(i)) = places[i];
    std::vector<char> angle;
    for (const SeriesCoordinate& coordinate : record.header().coordinates)
        angle.push_back(coordinate.angle ? 1 : 0);
    return {std::move(columns), std::move(radii), std::move(angle)};
}

// The points of the record near the places, each followed by its image: one segment in which missing samples part what
// does not follow each other. Empty when there are more than `most`.
std::optional<Series> gather(const SeriesStream& record, const Eigen::VectorXd& scale, const NearPlaces& places,
                             std::size_t most) {
    const Eigen::Index n = scale.size();
    const bool timed = record.timed();
    std::vector<double> values, times;
    const std::vector<double> gap(static_cast<std::size_t>(n), std::numeric_limits<double>::quiet_NaN());
    for (std::size_t first = 0; first < record.size(); first += block)
        // One point more: the image of the last. Who reads asks whether to stop.
        for (const Segment& piece : record.read(first, block + 1)) {
            const auto pairs = static_cast<std::size_t>(std::max<Eigen::Index>(piece.values.cols() - 1, 0));
            std::vector<char> kept(pairs, 0);
            tbb::parallel_for(tbb::blocked_range<std::size_t>(0, pairs, 4096),
                              [&](const tbb::blocked_range<std::size_t>& range) {
                                  Eigen::VectorXd state(n);
                                  for (std::size_t i = range.begin(); i < range.end(); ++i) {
                                      state = piece.values.col(static_cast<Eigen::Index>(i)).cwiseQuotient(scale);
                                      kept[i] = places.contains(state.data()) ? 1 : 0;
                                  }
                              });
            for (std::size_t i = 0; i < pairs; ++i) {
                if (!kept[i]) continue;
                const auto column = static_cast<Eigen::Index>(i);
                const auto append = [&](Eigen::Index at) {
                    values.insert(values.end(), piece.values.col(at).data(), piece.values.col(at).data() + n);
                    if (timed) times.push_back(piece.times[at]);
                };
                append(column);
                if (i + 1 < pairs && kept[i + 1]) continue;
                append(column + 1);
                values.insert(values.end(), gap.begin(), gap.end());
                if (timed) times.push_back(piece.times[column + 1]);
                if (values.size() > most * static_cast<std::size_t>(n)) return std::nullopt;
            }
        }
    Series series = record.header();
    const auto count = static_cast<Eigen::Index>(values.size()) / n;
    series.segments.push_back({"", Eigen::Map<const Eigen::MatrixXd>(values.data(), n, count),
                               Eigen::Map<const Eigen::VectorXd>(times.data(), timed ? count : 0)});
    return series;
}

// What a start has become: the cycle and its mirror partner, or nothing when refining did not lead back to it.
using Refined = std::vector<Cycle>;

std::vector<Refined> refined(const SeriesStream& record, const CycleSearchOptions& options,
                             const Eigen::VectorXd& scale, const std::vector<Start>& starts, std::size_t most) {
    std::optional<Series> near;
    // Where the record is denser than the stretches, the radii shrink until what is near them fits.
    for (double narrowed = 1.0; !near && narrowed > 1e-3; narrowed *= 0.5)
        near = gather(record, scale, places_of(record, options, starts, narrowed), most);
    std::vector<Refined> result(starts.size());
    if (!near) return result;
    const SectionPoints section(*near, options.symmetry_signs, scale, options.interrupted);
    std::optional<NeighbourIndex> timing;
    if (section.timed()) timing.emplace(section);
    const std::unique_ptr<CycleFinder> finder = local_map_finder(section, options);
    std::vector<CycleCandidate> drafts;
    for (const Start& start : starts)
        drafts.push_back(start.draft);
    const std::vector<std::optional<CycleCandidate>> polished = finder->polish(drafts);
    for (std::size_t i = 0; i < starts.size(); ++i) {
        if (!polished[i]) continue;
        CycleCandidate draft = *polished[i];
        if (timing) time_cycle(section, *timing, draft);
        const double limit = same_boxes * options.box;
        const double before = drafts[i].largest_sd(), after = draft.largest_sd();
        if (cycle_distance(section, drafts[i].points, draft.points, 0, false) <=
            same_cycle_tolerance(before, after, limit))
            publish(section, draft, same_cycle_tolerance(after, after, limit), result[i]);
    }
    return result;
}

// The cycle and its partner as they were found, where refining them did not lead back to them; what only the stretches
// tell (turns, code) is kept.
void replace(const std::vector<Cycle>& found, std::size_t old, Refined& cycles) {
    const Cycle& own = found[old];
    const Cycle& partner = own.mirror ? found[*own.mirror] : own;
    if (cycles.empty()) {
        cycles.push_back(own);
        if (own.mirror && *own.mirror != old) cycles.push_back(partner);
        cycles.front().quality.emplace_back("refined on a part of the record only");
        return;
    }
    for (Cycle& cycle : cycles) {
        const Cycle& before = &cycle == &cycles.front() ? own : partner;
        cycle.code = before.code;
        if (cycle.rotation.empty()) cycle.rotation = before.rotation;
    }
}

// Every cycle found, refined on all points near it: as many of them per reading of the record as fit into memory.
void refine_all(const SeriesStream& record, const CycleSearchOptions& options, const Eigen::VectorXd& scale,
                const std::vector<Start>& starts, std::size_t fitting, CycleSearch& search) {
    // Values and the list they are collected in, then the points and their grid: six times the points kept.
    const std::size_t most = fitting * copies / 6;
    const double share = static_cast<double>(fitting) / static_cast<double>(record.size());
    const double near_each = std::max(static_cast<double>(near_points), static_cast<double>(least_neighbours) / share);
    std::vector<Cycle> cycles;
    std::size_t readings = 0;
    for (std::size_t first = 0; first < starts.size(); ++readings) {
        // Twice the expected number: the stretches tell the density roughly. A point, its image and a gap.
        double expected = 0.0;
        std::size_t last = first;
        while (last < starts.size() && (last == first || expected < static_cast<double>(most)))
            expected += 2.0 * 3.0 * near_each * static_cast<double>(starts[last++].draft.points.cols());
        if (options.progress)
            options.progress(fmt::format("cycle {} of {}, refined on the whole record", first + 1, starts.size()),
                             first, starts.size());
        const std::vector<Start> some(starts.begin() + static_cast<std::ptrdiff_t>(first),
                                      starts.begin() + static_cast<std::ptrdiff_t>(last));
        std::vector<Refined> answers = refined(record, options, scale, some, most);
        for (std::size_t i = 0; i < answers.size(); ++i) {
            replace(search.cycles, some[i].cycle, answers[i]);
            const std::size_t place = cycles.size(), count = answers[i].size();
            for (std::size_t c = 0; c < count; ++c) {
                if (answers[i][c].mirror) answers[i][c].mirror = place + (count - 1 - c);
                cycles.push_back(std::move(answers[i][c]));
            }
        }
        first = last;
    }
    search.cycles = std::move(cycles);
    search.remarks.push_back(
        fmt::format("Cycles were refined on all points near them, read in {} passes over the record.", readings));
}

}  // namespace

CycleSearch find_cycles(const SeriesStream& record, const CycleSearchOptions& options, std::size_t memory) {
    models::stop_if_asked(options.interrupted);
    const auto numbers = static_cast<std::size_t>(record.header().dimension()) + (record.timed() ? 1 : 0);
    const std::size_t total = record.size(),
                      fitting = memory / (copies * sizeof(double) * std::max<std::size_t>(numbers, 1));
    if (total <= fitting) {
        Series series = record.header();
        series.segments = record.read(0, total);
        return find_cycles(series, options);
    }
    if (fitting < least_points)
        throw std::invalid_argument(fmt::format(
            "find_cycles: {} bytes of memory hold {} points, at least {} are needed", memory, fitting, least_points));
    CycleSearch search;
    std::vector<Start> starts;
    Eigen::VectorXd scale;
    const double share = static_cast<double>(fitting) / static_cast<double>(total);
    {
        const Series sample = stretches_of(record, fitting);
        search = find_cycles(sample, options);
        search.remarks.push_back(
            fmt::format("Of {} points {} fit into memory and were searched: {} stretches evenly over the record.",
                        total, sample.size(), stretches));
        // Local maps would be another analysis than the one asked for.
        const bool closest_return = options.method == CycleSearchOptions::Method::closest_return;
        const auto along_sheet = [&](const Cycle& cycle) {
            return std::ssize(cycle.multipliers) < record.header().dimension();
        };
        if (search.spline_map || closest_return || search.cycles.empty() || along_sheet(search.cycles.front()))
            return search;
        starts = starts_of(sample, options, search, share);
        scale = sample.scale();
    }
    refine_all(record, options, scale, starts, fitting, search);
    return search;
}

}  // namespace orbid::orbits
