#include "apps/stored_run/forecast.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>

#include <Eigen/Core>

#include "apps/estimation/job_problem.hpp"
#include "apps/job/data_job.hpp"
#include "apps/stored_run/segment_beginning.hpp"
#include "estimator/interface/not_finite.hpp"
#include "identification/problem/problem_residuals.hpp"
#include "models/arithmetic/orthogonal_factor.hpp"

namespace orbid::apps {

namespace {

/// Errors beyond this many sds end a forecast, and bound the band.
constexpr double band_sds = 2.0;
/// Samples over which the errors' rms is compared with that: one reading alone exceeds 2 sds every twentieth time.
constexpr std::size_t window = 10;

/// Free coordinates of a state.
Eigen::VectorXd free_part(const orbits::SeriesResidual& residual, const Eigen::VectorXd& state) {
    const auto& free = residual.free_coordinates();
    Eigen::VectorXd latents(static_cast<Eigen::Index>(free.size()));
    for (std::size_t i = 0; i < free.size(); ++i)
        latents[static_cast<Eigen::Index>(i)] = state[free[i]];
    return latents;
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
            const auto& coordinate = job.model.coordinate(observed);
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
            list[i].rms = detail::root_mean_square(list[i].rms, counts_[i]);
            list[i].sd = detail::root_mean_square(list[i].sd, counts_[i]);
        }
        return list;
    }
    [[nodiscard]] double normalised() const { return detail::root_mean_square(normalised_, count_); }

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

/// One segment whose initial state is known.
struct KnownSegment {
    const PredictionJob& job;
    const orbits::SeriesResidual& residual;
    std::size_t block;
    const estimator::BlockValue& value;
    const ErrorScales& scales;
    std::vector<Reading> readings;
    double stretch_end;  ///< of the samples that the initial state was fitted to

    [[nodiscard]] const orbits::Segment& segment() const { return residual.series().segments[residual.segment(block)]; }
    /// Of the error of a record.
    [[nodiscard]] double sd_of(Eigen::Index i) const {
        const auto group = static_cast<Eigen::Index>(residual.layout()[block].group[static_cast<std::size_t>(i)]);
        return residual.error_sd(block, i, value.e[i], scales.value[group], scales.relative[group]);
    }
};

/// What the stretch says of the initial state.
Eigen::MatrixXd state_covariance(const KnownSegment& known) {
    const Eigen::Index latents = known.value.e_z.cols();
    Eigen::MatrixXd information = Eigen::MatrixXd::Zero(latents, latents);
    for (const Reading& reading : known.readings) {
        if (reading.at > known.stretch_end) break;
        const Eigen::RowVectorXd row = known.value.e_z.row(reading.record) / known.sd_of(reading.record);
        information += row.transpose() * row;
    }
    return latents > 0 ? models::CompleteFactor(information).pseudo_inverse() : Eigen::MatrixXd();
}

/// Errors after the stretch, in time.
struct AheadErrors {
    std::vector<double> times;
    std::vector<double> sizes;    ///< of the derivatives by the initial state, over the coordinate's range
    std::vector<double> squares;  ///< of errors over their sd
};

/// How long after the stretch the errors of a window stay small.
void set_horizon(const KnownSegment& known, const AheadErrors& errors, SegmentForecast& out) {
    const std::vector<double>& squares = errors.squares;
    if (squares.empty()) return;
    const std::size_t width = std::min(squares.size(), window * known.job.derived.data[0].observe.size());
    double sum = std::accumulate(squares.begin(), squares.begin() + static_cast<std::ptrdiff_t>(width), 0.0);
    const double limit = band_sds * band_sds * static_cast<double>(width);
    std::size_t first = 0;
    while (sum <= limit && first + width < squares.size()) {
        sum += squares[first + width] - squares[first];
        ++first;
    }
    out.whole = sum <= limit;
    // The window that is beyond the limit got there by its last reading.
    out.horizon = errors.times[out.whole ? errors.times.size() - 1 : first + width - 1] - known.stretch_end;
}

/// Everything about one segment after its initial state is known.
void judge_segment(const KnownSegment& known, SegmentForecast& out, std::vector<ResidualRow>& rows) {
    const PredictionJob& job = known.job;
    const estimator::BlockValue& value = known.value;
    const orbits::Series& series = known.residual.series();
    const orbits::Segment& segment = known.segment();
    out.beginning = known.stretch_end - segment.times[0];
    const Eigen::MatrixXd of_state = state_covariance(known);
    const bool parameters = job.covariance.size() > 0 && value.e_theta.cols() == job.covariance.cols();
    const Eigen::VectorXd range = series.scale();

    Errors errors(job.derived, job.derived.data[0]);
    AheadErrors ahead;
    std::size_t inside = 0;
    const auto coordinates = job.derived.model.system->coordinates();
    for (const Reading& reading : known.readings) {
        const Eigen::Index i = reading.record;
        const auto& record = known.residual.records(known.block)[static_cast<std::size_t>(i)];
        const auto& coordinate = coordinates[static_cast<std::size_t>(record.coordinate)];
        Eigen::Index row = 0;
        while (series.coordinates[static_cast<std::size_t>(row)].name != coordinate.name)
            ++row;
        const double sd = known.sd_of(i);
        double variance = sd * sd;
        if (value.e_z.cols() > 0) variance += value.e_z.row(i) * of_state * value.e_z.row(i).transpose();
        if (parameters) variance += value.e_theta.row(i) * job.covariance * value.e_theta.row(i).transpose();
        const double band = std::sqrt(variance);
        const double observed = segment.values(row, record.sample);
        rows.push_back({job.derived.data[0].name, segment.label, std::string(coordinate.name), reading.at, observed,
                        observed - value.e[i], band});
        if (!(reading.at > known.stretch_end)) continue;
        errors.add(record.coordinate, value.e[i], sd);
        ahead.times.push_back(reading.at);
        ahead.sizes.push_back(value.e_z.row(i).norm() / range[row]);
        ahead.squares.push_back((value.e[i] / sd) * (value.e[i] / sd));
        // A band as wide as the range holds everything and says nothing; first order has ended long before.
        constexpr double wide = 0.125;
        if (band_sds * band < wide * range[row]) {
            ++out.covered;
            if (std::abs(value.e[i]) <= 1.96 * band) ++inside;
        }
    }
    out.ahead = errors.coordinates();
    out.ahead_normalised = errors.normalised();
    out.growth = growth_rate(ahead.times, ahead.sizes);
    if (out.covered > 0) out.coverage = static_cast<double>(inside) / static_cast<double>(out.covered);
    set_horizon(known, ahead, out);
}

void forecast_samples(const PredictionJob& job, const Experiment& record,
                      const std::function<void(std::size_t done)>& progress, Forecast& out) {
    const auto problem = identification_problem(job.derived, {&record, 1});
    const auto setup = estimate_setup(problem, fitted_labels(problem));
    const auto residual = single_shooting(problem, 0, setup);
    const Eigen::VectorXd theta = setup.start();
    ErrorScales scales = scales_of(*residual);
    const std::size_t blocks = residual->layout().size();

    std::vector<SegmentBeginning> beginnings;
    for (std::size_t b = 0; b < blocks; ++b) {
        // What follows takes one evaluation more.
        if (progress) progress(b);
        beginnings.push_back(fitted_beginning(job, record, residual->segment(b)));
    }
    if (!job.known_errors) {
        // What the fits left over, coordinate by coordinate.
        Eigen::VectorXd squares = Eigen::VectorXd::Zero(scales.value.size());
        double count = 0.0;
        for (const SegmentBeginning& beginning : beginnings) {
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
    const auto values = residual->evaluate(residual->initial_set(), theta, latents, true);
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
                const auto& coordinate = job.derived.model.coordinate(job.derived.data[0].observe[c]);
                one.course.push_back({std::string(coordinate.name), std::string(coordinate.unit),
                                      course.rms[static_cast<Eigen::Index>(c)], estimator::nan_value});
            }
        }
        if (!beginnings[b].ok) {
            one.message = "no initial state fits its beginning";
        } else if (values[b].status != estimator::BlockStatus::ok) {
            one.message = "the model cannot be simulated over it";
        } else {
            judge_segment({job, *residual, b, values[b], scales, readings_in_time(*residual, b),
                           residual->series().segments[residual->segment(b)].times[beginnings[b].samples - 1]},
                          one, out.rows);
        }
        out.segments.push_back(std::move(one));
    }
}

}  // namespace

Forecast forecast(const PredictionJob& job, const Experiment& record,
                  const std::function<void(std::size_t done)>& progress) {
    Forecast out;
    out.samples = record.series.sampling == orbits::Series::Sampling::samples;
    out.known_errors = job.known_errors;
    if (out.samples) {
        forecast_samples(job, record, progress, out);
    } else {
        detail::forecast_sections(job, record, out);
    }
    return out;
}

}  // namespace orbid::apps
