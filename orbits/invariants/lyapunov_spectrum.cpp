#include "orbits/invariants/lyapunov_spectrum.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>

#include <tbb/parallel_for.h>

#include "estimator/interface/not_finite.hpp"
#include "models/arithmetic/median.hpp"
#include "orbits/invariants/divergence_rate.hpp"
#include "orbits/invariants/kaplan_yorke.hpp"
#include "orbits/invariants/sample_stride.hpp"
#include "orbits/invariants/tangent_map.hpp"
#include "orbits/records/refusal.hpp"
#include "orbits/sections/neighbour_index.hpp"
#include "orbits/sections/section_points.hpp"

namespace orbid::orbits {
namespace {

// Steps at the head of a piece that only turn the directions: the errors of the frame fall by the ratio of
// neighbouring multipliers per step, of sampled flows (a tenth of the range per step) by e^-0.1 and slower.
constexpr std::size_t turning = 128;
// Steps of a piece beyond the turning: many times the correlation time; shorter ones for short series, so that there
// are enough pieces for their scatter to be known.
constexpr std::size_t longest_piece = 1024;
constexpr std::size_t fewest_pieces = 16;
constexpr std::size_t shortest_piece = 40;
constexpr std::size_t fewest_images = 500;

// Points on which orders and neighbours are tried.
constexpr std::size_t trial_points = 256;
// A wider neighbourhood that predicts this much worse than the best is as good and steadier: at heavy noise the
// prediction error is the point's own and hardly depends on the fit.
constexpr double as_good = 1.05;
constexpr std::size_t widest = 1000;  // neighbours tried at most: a fit takes a millisecond then
// Below this the exponents' errors are statistical: the cheapest fit will do. At least cubic, because quadratic maps
// across a curved sheet err as much as the sheet is thick (0.1 % of Lorenz's exponent, 10 % of Roessler's).
constexpr double exact_enough = 1e-9;
constexpr int exact_order = 3;

// Neighbours x steps: wide fits of noisy series follow fewer steps, since their exponents are biased by about as much
// as the statistical error is then. 2^18 steps of cubic maps of the plane (22 neighbours) are within it.
constexpr double budget = 6e6;

// The uncertainty of growth is looked at in every so manieth step: it costs a tenth of a fit.
constexpr std::size_t every = 16;
// A direction whose growth has this relative sd at more than such a share of the points is not resolved.
constexpr double unresolved = 0.5;
constexpr double unresolved_share = 0.1;

// Share by which reading errors may lower slopes before a remark is due: ln growth falls by about as much.
constexpr double noticeable_attenuation = 0.003;

struct Piece {
    std::size_t first = 0;   // step from point `first` is the first
    std::size_t length = 0;  // steps, the turning included
    std::size_t turn = 0;    // of these
};

// What one piece contributes.
struct Sum {
    Eigen::VectorXd ln_growth;
    std::vector<std::vector<double>> relative_sds;  // per direction
    double time = 0.0;
    double attenuation = 0.0;
    std::size_t steps = 0, lost = 0;
};

void validate_lyapunov(const LyapunovOptions& options, Eigen::Index dimension) {
    refuse_if(!(options.order >= 0 && options.order <= 4),
              "lyapunov_spectrum: order must be 1 to 4, or 0 for the data to choose, got {}", options.order);
    const auto least = static_cast<std::size_t>(coefficient_count(dimension, std::max(options.order, 1)) + 2);
    refuse_if(!(options.neighbours == 0 || options.neighbours >= least),
              "lyapunov_spectrum: neighbours must be at least {}, or 0 for the data to choose, got {}", least,
              options.neighbours);
    refuse_if(!(options.steps >= 1000), "lyapunov_spectrum: steps must be at least 1000, got {}", options.steps);
}

// The uninterrupted runs of the first points cut into pieces, evenly thinned out to the steps wanted.
std::vector<Piece> cut(const SectionPoints& points, std::size_t points_in_use, std::size_t steps) {
    std::vector<Piece> pieces;
    const std::size_t piece_length =
        std::clamp(std::min(steps, points_in_use) / fewest_pieces, shortest_piece, longest_piece);
    for (std::size_t i = 0; i < points_in_use;) {
        std::size_t end = i;
        while (end < points.size() && points.has_image(end))
            ++end;
        while (end - i >= shortest_piece) {
            // Short runs give a quarter to the turning.
            const std::size_t turn = std::min(turning, (end - i) / 4);
            std::size_t length = std::min(end - i, turn + piece_length);
            if (end - i - length < shortest_piece) length = end - i;
            pieces.push_back({i, length, turn});
            // The next piece turns on the last steps of this one.
            i += length < end - i ? length - turn : length;
        }
        i = end + 1;
    }
    const std::size_t wanted = std::max<std::size_t>(1, steps / piece_length);
    if (pieces.size() <= wanted) return pieces;
    std::vector<Piece> thinned;
    for (std::size_t p = 0; p < wanted; ++p)
        thinned.push_back(pieces[p * pieces.size() / wanted]);
    return thinned;
}

// Median prediction error over a sample of points; infinite when fits fail at more than half.
double trial(const SectionPoints& points, const NeighbourIndex& grid, const std::vector<std::size_t>& sample, int order,
             std::size_t neighbours) {
    std::vector<double> errors(sample.size(), std::numeric_limits<double>::infinity());
    tbb::parallel_for(tbb::blocked_range<std::size_t>(0, sample.size(), 32), [&](const auto& range) {
        TangentFitter fitter(points, grid, order, neighbours);
        for (std::size_t s = range.begin(); s < range.end(); ++s)
            if (const TangentMap& map = fitter.fit(sample[s]); map.usable) errors[s] = map.prediction_error;
    });
    return models::upper_median(std::move(errors));
}

// Order and neighbours with the smallest median prediction error.
void choose(const SectionPoints& points, const NeighbourIndex& grid, const std::vector<Piece>& pieces,
            const LyapunovOptions& options, LyapunovSpectrum& result) {
    std::size_t total = 0;
    for (const Piece& piece : pieces)
        total += piece.length;
    std::vector<std::size_t> sample;
    for (std::size_t s = 0; s < trial_points; ++s) {
        std::size_t step = s * total / trial_points, p = 0;
        while (step >= pieces[p].length)
            step -= pieces[p++].length;
        sample.push_back(pieces[p].first + step);
    }
    struct Choice {
        int order;
        std::size_t neighbours;
        double error;
    };
    std::vector<Choice> choices;
    for (int order = 1; order <= 4; ++order) {
        if (options.order != 0 ? options.order != order : order < 2) continue;
        const auto coefficients = static_cast<std::size_t>(coefficient_count(points.dimension(), order));
        if (options.neighbours != 0) {
            if (options.neighbours >= coefficients + 2)
                choices.push_back({order, options.neighbours, trial(points, grid, sample, order, options.neighbours)});
            continue;
        }
        // Twice the coefficients and, in steps of 2, up to a tenth of the points.
        std::size_t neighbours = 2 * coefficients + 2;
        double best = std::numeric_limits<double>::infinity();
        do {
            choices.push_back({order, neighbours, trial(points, grid, sample, order, neighbours)});
            best = std::min(best, choices.back().error);
            neighbours *= 2;
        } while (neighbours <= std::min<std::size_t>(points.image_count() / 20, widest) &&
                 !(choices.back().error > 1.5 * best) && !(best < exact_enough));
    }
    double best = std::numeric_limits<double>::infinity();
    for (const Choice& choice : choices)
        best = std::min(best, choice.error);
    double highest = 0.0;
    for (const Choice& choice : choices) {
        if (!(choice.error <= std::max(as_good * best, exact_enough))) continue;
        const auto width = static_cast<double>(choice.neighbours);
        const double merit = best < exact_enough ? (choice.order < exact_order ? 1e-9 : 1.0) / width : width;
        if (!(merit >= highest)) continue;
        highest = merit;
        result.order = choice.order;
        result.neighbours = choice.neighbours;
        result.prediction_error = choice.error;
    }
    if (result.order == 0) throw DataError("lyapunov_spectrum: too few different points for local maps");
}

Sum follow(const SectionPoints& points, const Piece& piece, TangentFitter& fitter) {
    const Eigen::Index n = points.dimension();
    Sum sum;
    sum.ln_growth = Eigen::VectorXd::Zero(n);
    sum.relative_sds.resize(static_cast<std::size_t>(n));
    Eigen::MatrixXd frame = Eigen::MatrixXd::Identity(n, n);
    std::size_t turn = piece.turn;
    for (std::size_t step = 0; step < piece.length; ++step) {
        const std::size_t i = piece.first + step;
        const TangentMap& map = fitter.fit(i);
        if (!map.usable) {
            ++sum.lost;
            turn = std::min(piece.length, step + 1 + piece.turn);  // the directions are lost too
            continue;
        }
        Eigen::MatrixXd next = map.jacobian * frame;
        const bool counts = step >= turn;
        for (Eigen::Index j = 0; j < n; ++j) {
            for (Eigen::Index earlier = 0; earlier < j; ++earlier)
                next.col(j) -= next.col(earlier).dot(next.col(j)) * next.col(earlier);
            const double growth = next.col(j).norm();
            if (counts) {
                sum.ln_growth[j] += std::log(growth);
                if (step % every == 0)
                    sum.relative_sds[static_cast<std::size_t>(j)].push_back(fitter.image_sd(frame.col(j)) / growth);
            }
            if (growth > 0.0)
                next.col(j) /= growth;
            else
                next.col(j) = Eigen::VectorXd::Unit(n, j);
        }
        frame = next;
        if (!counts) continue;
        ++sum.steps;
        sum.attenuation += map.attenuation;
        if (points.timed()) sum.time += points.return_time(i);
    }
    return sum;
}

void reduce(const std::vector<Sum>& sums, LyapunovSpectrum& result) {
    const Eigen::Index n = sums.front().ln_growth.size();
    double time = 0.0;
    Eigen::VectorXd growth = Eigen::VectorXd::Zero(n);
    std::size_t used = 0;
    for (const Sum& sum : sums) {
        growth += sum.ln_growth;
        result.steps += sum.steps;
        result.lost += sum.lost;
        result.attenuation += sum.attenuation;
        time += result.timed ? sum.time : static_cast<double>(sum.steps);
        used += sum.steps > 0 ? 1 : 0;
    }
    result.exponents = Eigen::VectorXd::Constant(n, estimator::nan_value);
    result.sds = Eigen::VectorXd::Constant(n, estimator::nan_value);
    if (result.steps == 0) return;
    result.attenuation /= static_cast<double>(result.steps);
    result.mean_time = time / static_cast<double>(result.steps);
    result.exponents = growth / time;
    // Ratio of two sums over pieces: the scatter of what remains of one after the ratio times the other.
    Eigen::VectorXd square = Eigen::VectorXd::Zero(n);
    for (const Sum& sum : sums) {
        const double own = result.timed ? sum.time : static_cast<double>(sum.steps);
        square += (sum.ln_growth - result.exponents * own).cwiseAbs2();
    }
    if (used > 1)
        result.sds = (square * (static_cast<double>(used) / static_cast<double>(used - 1))).cwiseSqrt() / time;
    for (Eigen::Index j = 0; j < n; ++j) {
        std::vector<double> sds;
        for (const Sum& sum : sums)
            sds.insert(sds.end(), sum.relative_sds[static_cast<std::size_t>(j)].begin(),
                       sum.relative_sds[static_cast<std::size_t>(j)].end());
        if (sds.empty()) continue;
        const auto above = static_cast<std::size_t>(unresolved_share * static_cast<double>(sds.size()));
        const std::size_t place = sds.size() - 1 - above;
        if (models::ranked(std::move(sds), place) < unresolved && std::isfinite(result.exponents[j])) continue;
        // Directions further down lie across this one as well.
        result.exponents.tail(n - j).setConstant(estimator::nan_value);
        result.sds.tail(n - j).setConstant(estimator::nan_value);
        return;
    }
}

}  // namespace

LyapunovSpectrum lyapunov_spectrum(const Series& series, const LyapunovOptions& options) {
    validate_lyapunov(options, series.dimension());
    LyapunovSpectrum result;
    const bool samples = series.sampling == Series::Sampling::samples;
    if (samples) result.stride = sample_stride(series);
    const SectionPoints points(samples ? strided(series, result.stride) : series, options.symmetry_signs, {},
                               options.interrupted);
    refuse_record_if(points.image_count() < fewest_images,
                     "lyapunov_spectrum: {} points have an image, at least {} are needed", points.image_count(),
                     fewest_images);
    std::vector<Piece> pieces = cut(points, points.size() / result.stride, options.steps);
    refuse_record_if(pieces.empty(), "lyapunov_spectrum: no piece of the series is longer than {} steps",
                     shortest_piece);
    const NeighbourIndex grid(points);
    choose(points, grid, pieces, options, result);
    const auto affordable = static_cast<std::size_t>(budget / static_cast<double>(result.neighbours));
    if (affordable < options.steps) pieces = cut(points, points.size() / result.stride, affordable);
    result.timed = points.timed();
    std::vector<Sum> sums(pieces.size());
    tbb::parallel_for(tbb::blocked_range<std::size_t>(0, pieces.size(), 1), [&](const auto& range) {
        TangentFitter fitter(points, grid, result.order, result.neighbours);
        for (std::size_t p = range.begin(); p < range.end(); ++p)
            sums[p] = follow(points, pieces[p], fitter);
    });
    reduce(sums, result);
    result.dimension = kaplan_yorke_dimension(result.exponents);

    const DivergenceRate divergence = divergence_rate(points, grid);
    result.divergence_rate = divergence.rate / result.mean_time;
    result.divergence_sd = divergence.sd / result.mean_time;
    if (result.attenuation > noticeable_attenuation)
        result.remarks.push_back("reading errors lower the slopes of the local maps by about " +
                                 std::to_string(result.attenuation * 100.0) + " %: exponents are biased");
    return result;
}

}  // namespace orbid::orbits
