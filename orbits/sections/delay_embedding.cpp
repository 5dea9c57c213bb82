#include "orbits/sections/delay_embedding.hpp"

#include <algorithm>
#include <cmath>

#include <fmt/format.h>

#include "orbits/records/refusal.hpp"
#include "orbits/sections/neighbour_index.hpp"
#include "orbits/sections/section_points.hpp"

namespace orbid::orbits {
namespace {

constexpr std::size_t least_samples = 500;

// Bins per axis of the joint counts: about five pairs per cell, at most 64 bins (more resolve nothing that moves the
// minimum).
constexpr double pairs_per_cell = 5.0;
constexpr int most_bins = 64;

// Values after a minimum that must lie above it.
constexpr int confirming = 3;

// Kennel, Brown and Abarbanel: a neighbour is false when the next coordinate parts the two by more than this multiple
// of their distance, or to more than this multiple of the observable's sd; this share of false ones counts as none.
constexpr double parted = 15.0;
constexpr double far_apart = 2.0;
constexpr double tolerated = 0.01;

constexpr std::size_t most_vectors = 20000;
constexpr std::size_t most_compared = 4000;

// Nearest vectors looked through for one that is no neighbour in time.
constexpr std::size_t looked_through = 64;

// Number of the equally probable bin of every reading; -1 where it is missing.
std::vector<std::vector<int>> bins_of(const Series& samples, Eigen::Index coordinate, int bins) {
    std::vector<double> sorted;
    for (const Segment& segment : samples.segments)
        for (const double value : segment.values.row(coordinate))
            if (std::isfinite(value)) sorted.push_back(value);
    std::sort(sorted.begin(), sorted.end());
    std::vector<double> edges;
    for (int b = 1; b < bins; ++b)
        edges.push_back(sorted[sorted.size() * static_cast<std::size_t>(b) / static_cast<std::size_t>(bins)]);
    std::vector<std::vector<int>> result;
    for (const Segment& segment : samples.segments) {
        std::vector<int>& own = result.emplace_back();
        for (const double value : segment.values.row(coordinate))
            own.push_back(std::isfinite(value)
                              ? static_cast<int>(std::upper_bound(edges.begin(), edges.end(), value) - edges.begin())
                              : -1);
    }
    return result;
}

double mutual_information(const std::vector<std::vector<int>>& bins, int count, std::size_t delay) {
    const auto size = static_cast<std::size_t>(count);
    std::vector<double> joint(size * size, 0.0), now(size, 0.0), later(size, 0.0);
    double total = 0.0;
    for (const std::vector<int>& segment : bins)
        for (std::size_t i = 0; i + delay < segment.size(); ++i) {
            if (segment[i] < 0 || segment[i + delay] < 0) continue;
            const auto a = static_cast<std::size_t>(segment[i]), b = static_cast<std::size_t>(segment[i + delay]);
            joint[a * size + b] += 1.0;
            now[a] += 1.0;
            later[b] += 1.0;
            total += 1.0;
        }
    double information = 0.0;
    for (std::size_t a = 0; a < size; ++a)
        for (std::size_t b = 0; b < size; ++b)
            if (joint[a * size + b] > 0.0)
                information +=
                    joint[a * size + b] / total * std::log(joint[a * size + b] * total / (now[a] * later[b]));
    return information;
}

void choose_delay(const Series& samples, const DelayEmbeddingOptions& options, DelayEmbedding& embedding) {
    std::size_t longest = 0;
    for (const Segment& segment : samples.segments)
        longest = std::max(longest, static_cast<std::size_t>(segment.values.cols()));
    const auto most = static_cast<int>(std::min(static_cast<std::size_t>(options.largest_delay), longest / 4));
    const double pairs = static_cast<double>(samples.size());
    const int bins = std::clamp(static_cast<int>(std::sqrt(pairs / pairs_per_cell)), 4, most_bins);
    const auto numbers = bins_of(samples, options.coordinate, bins);
    // Counts of independent values scatter the information by about this much (its bias is (bins - 1)^2 / (2 pairs)).
    const double scatter = static_cast<double>(bins) / pairs;
    std::vector<double>& information = embedding.mutual_information;
    int fallen = 0;  // first delay at which it is below 1/e of its first value
    for (int delay = 1; delay <= most; ++delay) {
        information.push_back(mutual_information(numbers, bins, static_cast<std::size_t>(delay)));
        if (fallen == 0 && information.back() < information.front() / std::exp(1.0)) fallen = delay;
        const int candidate = delay - confirming;
        if (candidate < 1) continue;
        const double least = information[static_cast<std::size_t>(candidate - 1)];
        const bool lowest =
            std::all_of(information.end() - confirming, information.end(), [&](double later) { return later > least; });
        if (lowest && information.back() > least + scatter) {
            embedding.delay = candidate;
            return;
        }
    }
    embedding.minimum_found = false;
    embedding.delay = fallen > 0 ? fallen : std::max(1, most);
}

// Vectors of `dimension` entries and the entry that follows, evenly spread; columns, the follower last.
Eigen::MatrixXd some_vectors(const Series& samples, Eigen::Index coordinate, int delay, int dimension,
                             std::vector<Eigen::Index>& instants) {
    const std::size_t stride = samples.size() / most_vectors + 1;
    const Eigen::Index reach = static_cast<Eigen::Index>(delay) * dimension;
    std::vector<Eigen::VectorXd> vectors;
    instants.clear();
    std::size_t number = 0;
    Eigen::Index offset = 0;
    for (const Segment& segment : samples.segments) {
        for (Eigen::Index i = 0; i + reach < segment.values.cols(); ++i) {
            if (number++ % stride != 0) continue;
            Eigen::VectorXd vector(dimension + 1);
            for (Eigen::Index j = 0; j <= dimension; ++j)
                vector[j] = segment.values(coordinate, i + j * delay);
            if (!vector.allFinite()) continue;
            vectors.push_back(std::move(vector));
            instants.push_back(offset + i);
        }
        offset += segment.values.cols() + reach;  // segments are no neighbours in time
    }
    Eigen::MatrixXd result(dimension + 1, static_cast<Eigen::Index>(vectors.size()));
    for (std::size_t k = 0; k < vectors.size(); ++k)
        result.col(static_cast<Eigen::Index>(k)) = vectors[k];
    return result;
}

double false_share(const Series& samples, Eigen::Index coordinate, int delay, int dimension) {
    std::vector<Eigen::Index> instants;
    const Eigen::MatrixXd vectors = some_vectors(samples, coordinate, delay, dimension, instants);
    if (vectors.cols() < 100) return 1.0;
    // Neighbours among the vectors: a section series of them serves the search. The last has no image there.
    Series series;
    for (int d = 0; d < dimension; ++d)
        series.coordinates.push_back({fmt::format("x{}", d), "", false});
    series.segments.push_back({"0", vectors.topRows(dimension), {}, {}});
    const SectionPoints points(series);
    const NeighbourIndex grid(points);
    const auto own = vectors.row(0);
    const double sd = std::sqrt((own.array() - own.mean()).square().mean());
    const Eigen::Index apart = static_cast<Eigen::Index>(delay) * dimension;
    const Eigen::Index stride = std::max<Eigen::Index>(1, vectors.cols() / static_cast<Eigen::Index>(most_compared));
    double compared = 0.0, wrong = 0.0;
    for (Eigen::Index k = 0; k + 1 < vectors.cols(); k += stride) {
        const auto at = static_cast<std::size_t>(k);
        const Eigen::VectorXd place = Eigen::Map<const Eigen::VectorXd>(points.point(at), dimension);
        for (const Neighbour& near : grid.nearest(place, looked_through)) {
            if (std::abs(instants[near.index] - instants[at]) <= apart) continue;
            const auto other = static_cast<Eigen::Index>(near.index);
            const double distance = (vectors.col(k) - vectors.col(other)).head(dimension).norm();
            const double next = std::abs(vectors(dimension, k) - vectors(dimension, other));
            compared += 1.0;
            wrong += next > parted * distance || std::hypot(distance, next) > far_apart * sd ? 1.0 : 0.0;
            break;
        }
    }
    return compared > 0.0 ? wrong / compared : 1.0;
}

void validate(const Series& samples, const DelayEmbeddingOptions& options) {
    refuse_if(samples.sampling != Series::Sampling::samples,
              "embed: the series holds sections; it needs samples in time");
    refuse_if(!(options.coordinate >= 0 && options.coordinate < samples.dimension()),
              "embed: the coordinate must be in [0, {}), got {}", samples.dimension(), options.coordinate);
    refuse_if(samples.coordinate(options.coordinate).angle,
              "embed: '{}' is an angle and jumps at the end of its turn; embed its sine or cosine",
              samples.coordinate(options.coordinate).name);
    refuse_if(
        !(options.delay >= 0 && options.dimension >= 0 && options.largest_delay >= 1 && options.largest_dimension >= 1),
        "embed: delay and dimension must be at least 0, the largest at least 1; got {}, {}, {}, {}", options.delay,
        options.dimension, options.largest_delay, options.largest_dimension);
    std::size_t present = 0;
    for (const Segment& segment : samples.segments)
        present += static_cast<std::size_t>(
            segment.values.row(options.coordinate).array().isFinite().cast<Eigen::Index>().sum());
    refuse_record_if(!(present >= least_samples), "embed: needs at least {} samples, got {}", least_samples, present);
}

}  // namespace

DelayEmbedding embed(const Series& samples, const DelayEmbeddingOptions& options) {
    validate(samples, options);
    DelayEmbedding embedding;
    embedding.delay = options.delay;
    embedding.dimension = options.dimension;
    if (options.delay == 0) choose_delay(samples, options, embedding);
    if (options.dimension == 0) {
        embedding.unfolded = false;
        for (int m = 1; m <= options.largest_dimension && !embedding.unfolded; ++m) {
            embedding.dimension = m;
            embedding.false_neighbours.push_back(false_share(samples, options.coordinate, embedding.delay, m));
            embedding.unfolded = embedding.false_neighbours.back() <= tolerated;
        }
    }

    if (options.rise) embedding.dimension = std::max(embedding.dimension, 2);
    const SeriesCoordinate& observable = samples.coordinate(options.coordinate);
    embedding.series.sampling = Series::Sampling::samples;
    embedding.series.phase = samples.phase;
    embedding.series.origin = samples.origin;
    for (int d = 0; d < embedding.dimension; ++d)
        embedding.series.coordinates.push_back(
            {d == 0 ? observable.name
                    : fmt::format("{}_{}", observable.name, options.rise && d == 1 ? "rise" : std::to_string(d)),
             observable.unit, false});
    const Eigen::Index reach = static_cast<Eigen::Index>(embedding.delay) * (embedding.dimension - 1);
    for (const Segment& segment : samples.segments) {
        const Eigen::Index count = segment.values.cols() - reach;
        if (count < 1) continue;
        Segment piece;
        piece.label = segment.label;
        piece.values.resize(embedding.dimension, count);
        for (Eigen::Index d = 0; d < embedding.dimension; ++d)
            piece.values.row(d) = segment.values.row(options.coordinate).segment(d * embedding.delay, count);
        if (options.rise) piece.values.row(1) = piece.values.row(1) - piece.values.row(0);
        piece.times = segment.times.head(count);
        embedding.series.segments.push_back(std::move(piece));
    }
    refuse_record_if(embedding.series.segments.empty(), "embed: no segment has the {} samples of a vector", reach + 1);
    return embedding;
}

}  // namespace orbid::orbits
