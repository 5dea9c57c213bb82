#include "apps/stored_run/forecast.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <optional>
#include <variant>

#include <fmt/format.h>
#include <Eigen/Core>

#include "apps/estimation/estimate_residuals.hpp"
#include "apps/estimation/estimate_setup.hpp"
#include "apps/stored_run/root_mean_square.hpp"
#include "estimator/interface/not_finite.hpp"
#include "models/arithmetic/orthogonal_factor.hpp"
#include "orbits/records/data_error.hpp"

namespace orbid::apps {

namespace {

/// Errors beyond this many sds end a forecast, and bound the band.
constexpr double band_sds = 2.0;
/// Samples over which the errors' rms is compared with that: one reading alone exceeds 2 sds every twentieth time.
constexpr std::size_t window = 10;

/// The relative parts of the errors, and scales; as the residual's groups have them.
struct Scales {
    Eigen::VectorXd value;
    Eigen::VectorXd relative;
};

Scales scales_of(const orbits::SeriesResidual& residual) {
    const auto count = static_cast<Eigen::Index>(residual.groups().size());
    Scales scales{Eigen::VectorXd::Ones(count), Eigen::VectorXd::Zero(count)};
    for (Eigen::Index g = 0; g < count; ++g) {
        const estimator::Group& group = residual.groups()[static_cast<std::size_t>(g)];
        if (group.scale.value > 0.0) scales.value[g] = group.scale.value;
        if (const auto* relative = std::get_if<estimator::RelativeErrors>(&group.distribution))
            scales.relative[g] = relative->relative.value;
    }
    return scales;
}

/// Free coordinates of a state.
Eigen::VectorXd free_part(const orbits::SeriesResidual& residual, const Eigen::VectorXd& state) {
    const auto& free = residual.free_coordinates();
    Eigen::VectorXd latents(static_cast<Eigen::Index>(free.size()));
    for (std::size_t i = 0; i < free.size(); ++i)
        latents[static_cast<Eigen::Index>(i)] = state[free[i]];
    return latents;
}

/// A job whose record begins at a state that is known already, as a start.
Job starting_at(const Job& job, const Eigen::VectorXd& state) {
    Job started = job;
    for (std::size_t i = 0; i < started.data[0].initial_state.size(); ++i) {
        InitialValueJob& initial = started.data[0].initial_state[i];
        if (initial.estimate) initial.value = state[static_cast<Eigen::Index>(i)];
    }
    return started;
}

/// The first samples of one segment as a record of their own.
Experiment beginning_of(const Experiment& record, std::size_t segment, Eigen::Index samples) {
    Experiment part;
    part.series = record.series;
    orbits::Segment cut = record.series.segments[segment];
    cut.values = cut.values.leftCols(samples).eval();
    cut.times = cut.times.head(samples).eval();
    if (cut.deviations.size() > 0) cut.deviations = cut.deviations.leftCols(samples).eval();
    part.series.segments = {std::move(cut)};
    if (!record.inputs.empty()) part.inputs = {record.inputs[segment]};
    return part;
}

/// The state in which a segment begins, fitted to its first samples.
struct Beginning {
    bool ok = false;
    Eigen::Index samples = 0;
    Eigen::VectorXd state;
    Eigen::VectorXd rms;  ///< per observed coordinate
};

Beginning fitted_beginning(const PredictionJob& job, const Experiment& record, std::size_t segment) {
    constexpr Eigen::Index least = 20;
    constexpr Eigen::Index share = 10;  // of the segment: a tenth
    constexpr double good = 2.0;        // normalised rms
    const Eigen::Index count = record.series.segments[segment].values.cols();
    const Eigen::Index most = std::max(count / share, std::min(least, count / 2));
    Beginning found;
    Eigen::Index samples = std::min(most, least);
    while (true) {
        const Experiment part = beginning_of(record, segment, samples);
        const Job& started = found.ok ? starting_at(job.derived, found.state) : job.derived;
        const EstimateSetup setup = estimate_setup(started, fitted_labels(started, {part}));
        std::optional<orbits::SegmentPrediction> fit;
        try {
            const auto residual = single_shooting(started, 0, setup, part);
            const Scales scales = scales_of(*residual);
            fit = residual->predict(setup.start(), scales.value, {0}, scales.relative).front();
        } catch (const orbits::DataError&) {
            // Too few readings among these samples: more of them may do.
        }
        const bool usable = fit && fit->status == estimator::BlockStatus::ok && fit->state.allFinite();
        // Without known errors a first fit counts, and later ones as long as they are no worse.
        const double limit = job.known_errors || !found.ok ? good : good * std::max(found.rms.norm(), 1e-300);
        const double misfit =
            job.known_errors || !found.ok ? (usable ? fit->normalised_rms : 0.0) : (usable ? fit->rms.norm() : 0.0);
        const bool better = usable && (!found.ok || misfit <= limit);
        if (better) found = {true, samples, fit->state, fit->rms};
        if ((found.ok && !better) || samples >= most) return found;
        samples = std::min(2 * samples, most);
    }
}

/// A record of a segment, in the order of time.
struct Reading {
    double at;
    Eigen::Index record;  ///< within the block
};

std::vector<Reading> readings_in_time(const orbits::SeriesResidual& residual, std::size_t block) {
    const auto& segment = residual.series().segments[residual.segment(block)];
    std::vector<Reading> list;
    const auto& records = residual.records(block);
    for (std::size_t i = 0; i < records.size(); ++i)
        if (records[i].sample >= 0) list.push_back({segment.times[records[i].sample], static_cast<Eigen::Index>(i)});
    std::stable_sort(list.begin(), list.end(), [](const Reading& a, const Reading& b) { return a.at < b.at; });
    return list;
}

/// Sums of squares per observed coordinate.
class Errors {
public:
    Errors(const Job& job, const DataJob& data) {
        for (const Eigen::Index observed : data.observe) {
            const auto& coordinate = job.model.system->coordinates()[static_cast<std::size_t>(observed)];
            index_.push_back(observed);
            list_.push_back({std::string(coordinate.name), std::string(coordinate.unit), 0.0, 0.0});
            counts_.push_back(0);
        }
    }
    void add(Eigen::Index coordinate, double error, double sd) {
        const auto at = static_cast<std::size_t>(std::find(index_.begin(), index_.end(), coordinate) - index_.begin());
        list_[at].rms += error * error;
        list_[at].sd += sd * sd;
        ++counts_[at];
        normalised_ += (error / sd) * (error / sd);
        ++count_;
    }
    [[nodiscard]] std::vector<CoordinateForecast> coordinates() const {
        auto list = list_;
        for (std::size_t i = 0; i < list.size(); ++i) {
            list[i].rms = root_mean_square(list[i].rms, counts_[i]);
            list[i].sd = root_mean_square(list[i].sd, counts_[i]);
        }
        return list;
    }
    [[nodiscard]] double normalised() const { return root_mean_square(normalised_, count_); }

private:
    std::vector<Eigen::Index> index_;
    std::vector<CoordinateForecast> list_;
    std::vector<std::size_t> counts_;
    double normalised_ = 0.0;
    std::size_t count_ = 0;
};

/// Slope of ln(values) over times by least squares.
double growth_rate(const std::vector<double>& times, const std::vector<double>& sizes) {
    double n = 0.0;
    double mean_t = 0.0;
    double mean_y = 0.0;
    for (std::size_t k = 0; k < times.size(); ++k) {
        if (!(sizes[k] > 0.0) || !std::isfinite(sizes[k])) continue;
        n += 1.0;
        mean_t += times[k];
        mean_y += std::log(sizes[k]);
    }
    if (n < 3.0) return estimator::nan_value;
    mean_t /= n;
    mean_y /= n;
    double tt = 0.0;
    double ty = 0.0;
    for (std::size_t k = 0; k < times.size(); ++k) {
        if (!(sizes[k] > 0.0) || !std::isfinite(sizes[k])) continue;
        tt += (times[k] - mean_t) * (times[k] - mean_t);
        ty += (times[k] - mean_t) * (std::log(sizes[k]) - mean_y);
    }
    return tt > 0.0 ? ty / tt : estimator::nan_value;
}

/// Everything about one segment after its initial state is known.
void judge_segment(const PredictionJob& job, const orbits::SeriesResidual& residual, std::size_t block,
                   const estimator::BlockValue& value, const Beginning& beginning, const Scales& scales,
                   SegmentForecast& out, std::vector<ResidualRow>& rows) {
    const auto readings = readings_in_time(residual, block);
    const orbits::Segment& segment = residual.series().segments[residual.segment(block)];
    const auto& layout = residual.layout()[block];
    const double stretch_end = segment.times[beginning.samples - 1];
    out.beginning = stretch_end - segment.times[0];
    const auto sd_of = [&](Eigen::Index i) {
        const auto group = static_cast<Eigen::Index>(layout.group[static_cast<std::size_t>(i)]);
        return residual.error_sd(block, i, value.e[i], scales.value[group], scales.relative[group]);
    };
    // What the stretch says of the initial state.
    const Eigen::Index latents = value.e_z.cols();
    Eigen::MatrixXd information = Eigen::MatrixXd::Zero(latents, latents);
    for (const Reading& reading : readings) {
        if (reading.at > stretch_end) break;
        const Eigen::RowVectorXd row = value.e_z.row(reading.record) / sd_of(reading.record);
        information += row.transpose() * row;
    }
    const Eigen::MatrixXd state_covariance =
        latents > 0 ? models::CompleteFactor(information).pseudo_inverse() : Eigen::MatrixXd();
    const bool parameters = job.covariance.size() > 0 && value.e_theta.cols() == job.covariance.cols();
    const Eigen::VectorXd range = residual.series().scale();

    Errors errors(job.derived, job.derived.data[0]);
    std::vector<double> times;
    std::vector<double> sizes;
    std::vector<double> squares;  // of errors over their sd, in time
    std::size_t inside = 0;
    const auto coordinates = job.derived.model.system->coordinates();
    for (const Reading& reading : readings) {
        const Eigen::Index i = reading.record;
        const auto& record = residual.records(block)[static_cast<std::size_t>(i)];
        const auto& coordinate = coordinates[static_cast<std::size_t>(record.coordinate)];
        Eigen::Index row = 0;
        while (residual.series().coordinates[static_cast<std::size_t>(row)].name != coordinate.name)
            ++row;
        const double sd = sd_of(i);
        double variance = sd * sd;
        if (latents > 0) variance += value.e_z.row(i) * state_covariance * value.e_z.row(i).transpose();
        if (parameters) variance += value.e_theta.row(i) * job.covariance * value.e_theta.row(i).transpose();
        const double band = std::sqrt(variance);
        const double observed = segment.values(row, record.sample);
        rows.push_back({job.derived.data[0].name, segment.label, std::string(coordinate.name), reading.at, observed,
                        observed - value.e[i], band});
        if (!(reading.at > stretch_end)) continue;
        errors.add(record.coordinate, value.e[i], sd);
        times.push_back(reading.at);
        sizes.push_back(value.e_z.row(i).norm() / range[row]);
        squares.push_back((value.e[i] / sd) * (value.e[i] / sd));
        // A band as wide as the range holds everything and says nothing; first order has ended long before.
        constexpr double wide = 0.125;
        if (band_sds * band < wide * range[row]) {
            ++out.covered;
            if (std::abs(value.e[i]) <= 1.96 * band) ++inside;
        }
    }
    out.ahead = errors.coordinates();
    out.ahead_normalised = errors.normalised();
    out.growth = growth_rate(times, sizes);
    if (out.covered > 0) out.coverage = static_cast<double>(inside) / static_cast<double>(out.covered);
    if (squares.empty()) return;
    const std::size_t width = std::min(squares.size(), window * job.derived.data[0].observe.size());
    double sum = std::accumulate(squares.begin(), squares.begin() + static_cast<std::ptrdiff_t>(width), 0.0);
    const double limit = band_sds * band_sds * static_cast<double>(width);
    std::size_t first = 0;
    while (sum <= limit && first + width < squares.size()) {
        sum += squares[first + width] - squares[first];
        ++first;
    }
    out.whole = sum <= limit;
    // The window that is beyond the limit got there by its last reading.
    out.horizon = times[out.whole ? times.size() - 1 : first + width - 1] - stretch_end;
}

void forecast_samples(const PredictionJob& job, const Experiment& record, Forecast& out) {
    const EstimateSetup setup = estimate_setup(job.derived, fitted_labels(job.derived, {record}));
    const auto residual = single_shooting(job.derived, 0, setup, record);
    const Eigen::VectorXd theta = setup.start();
    Scales scales = scales_of(*residual);
    const std::size_t blocks = residual->layout().size();

    std::vector<Beginning> beginnings;
    for (std::size_t b = 0; b < blocks; ++b)
        beginnings.push_back(fitted_beginning(job, record, residual->segment(b)));
    if (!job.known_errors) {
        // What the fits left over, coordinate by coordinate.
        Eigen::VectorXd squares = Eigen::VectorXd::Zero(scales.value.size());
        double count = 0.0;
        for (const Beginning& beginning : beginnings) {
            if (!beginning.ok || !beginning.rms.allFinite()) continue;
            squares.head(beginning.rms.size()) += beginning.rms.cwiseAbs2();
            count += 1.0;
        }
        for (Eigen::Index g = 0; g < squares.size(); ++g)
            if (count > 0.0 && squares[g] > 0.0) scales.value[g] = std::sqrt(squares[g] / count);
    }
    std::vector<Eigen::VectorXd> latents;
    for (std::size_t b = 0; b < blocks; ++b)
        latents.push_back(free_part(*residual, beginnings[b].ok ? beginnings[b].state : residual->guessed_state(b)));
    const auto values = residual->evaluate(theta, latents, true);
    for (std::size_t b = 0; b < blocks; ++b) {
        SegmentForecast one;
        const orbits::Segment& segment = record.series.segments[residual->segment(b)];
        one.segment = segment.label;
        one.readings = residual->records(b).size();
        one.duration = segment.times[segment.times.size() - 1] - segment.times[0];
        const auto course = residual->predict(theta, scales.value, {residual->segment(b)}, scales.relative).front();
        if (course.status == estimator::BlockStatus::ok) {
            one.course_normalised = course.normalised_rms;
            for (std::size_t c = 0; c < job.derived.data[0].observe.size(); ++c) {
                const auto& coordinate =
                    job.derived.model.system->coordinates()[static_cast<std::size_t>(job.derived.data[0].observe[c])];
                one.course.push_back({std::string(coordinate.name), std::string(coordinate.unit),
                                      course.rms[static_cast<Eigen::Index>(c)], estimator::nan_value});
            }
        }
        if (!beginnings[b].ok) {
            one.message = "no initial state fits its beginning";
        } else if (values[b].status != estimator::BlockStatus::ok) {
            one.message = "the model cannot be simulated over it";
        } else {
            judge_segment(job, *residual, b, values[b], beginnings[b], scales, one, out.rows);
        }
        out.segments.push_back(std::move(one));
    }
}

}  // namespace

Forecast forecast(const PredictionJob& job, const Experiment& record) {
    Forecast out;
    out.samples = record.series.sampling == orbits::Series::Sampling::samples;
    out.known_errors = job.known_errors;
    if (out.samples) {
        forecast_samples(job, record, out);
    } else {
        detail::forecast_sections(job, record, out);
    }
    return out;
}

}  // namespace orbid::apps
