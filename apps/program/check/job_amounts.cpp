#include "apps/program/check/job_amounts.hpp"

#include <algorithm>
#include <cmath>

#include "apps/job/data_job.hpp"
#include "apps/job/estimate_job.hpp"

namespace orbid::apps {

namespace {

// Rates of one core where none was measured, of the jobs in configs/ (a shared machine, 2.5 GHz or so).
constexpr double seconds_per_crossing = 8e-6;  // one coordinate from section to section; maps take a hundredth
constexpr double seconds_per_sample = 1e-6;    // one coordinate over a sampling interval

bool is_fitted(const DataJob& data, const std::string& label) {
    const auto among = [&label](const std::vector<std::string>& labels) {
        return std::find(labels.begin(), labels.end(), label) != labels.end();
    };
    return data.fit ? among(*data.fit) : !among(data.predict);
}

/// Of the trajectories of a simulation.
double fitted_trajectories(const DataJob& data) {
    const auto all = static_cast<double>(data.simulation->trajectories);
    const auto left_out = static_cast<double>(data.predict.size());
    return std::clamp(data.fit ? static_cast<double>(data.fit->size()) : all - left_out, 0.0, all);
}

}  // namespace

double JobAmounts::points(std::size_t index) const {
    const DataJob& data = job_.data[index];
    if (data.simulation) {
        const SimulationJob& run = *data.simulation;
        return data.sampling() == orbits::Series::Sampling::section
                   ? static_cast<double>(run.sections)
                   : static_cast<double>(run.count) * static_cast<double>(run.trajectories);
    }
    return index < data_.records.size() && data_.records[index] ? static_cast<double>(data_.records[index]->points)
                                                                : 0.0;
}

double JobAmounts::fitted_points(std::size_t index) const {
    const DataJob& data = job_.data[index];
    if (data.simulation)
        return points(index) * fitted_trajectories(data) / static_cast<double>(data.simulation->trajectories);
    if (index >= data_.experiments.size()) return points(index);
    double sum = 0.0;
    for (const orbits::Segment& segment : data_.experiments[index].series.segments)
        if (is_fitted(data, segment.label)) sum += static_cast<double>(segment.values.cols());
    return sum;
}

double JobAmounts::fitted_segments(std::size_t index) const {
    const DataJob& data = job_.data[index];
    if (data.simulation) return fitted_trajectories(data);
    if (index >= data_.experiments.size()) return static_cast<double>(segments(index));
    const auto& all = data_.experiments[index].series.segments;
    return static_cast<double>(
        std::count_if(all.begin(), all.end(), [&](const orbits::Segment& one) { return is_fitted(data, one.label); }));
}

std::size_t JobAmounts::segments(std::size_t index) const {
    return index < data_.records.size() && data_.records[index] ? data_.records[index]->segments : 0;
}

const FlowRate* JobAmounts::rate(std::size_t index) const {
    return index < rates_.size() && std::isfinite(rates_[index].value) ? &rates_[index] : nullptr;
}

double JobAmounts::step(std::size_t index) const {
    if (const FlowRate* known = rate(index)) return known->value;
    const auto n = static_cast<double>(job_.model.system->dimension());
    if (job_.model.system->kind() == models::Kind::map) return 0.01 * seconds_per_crossing * n;
    const bool section = job_.data[index].sampling() == orbits::Series::Sampling::section;
    return (section ? seconds_per_crossing : seconds_per_sample) * n;
}

double JobAmounts::derivative_step(std::size_t index) const {
    const FlowRate* known = rate(index);
    return known != nullptr && std::isfinite(known->derivatives) ? known->derivatives : step(index) * directions();
}

double JobAmounts::waveform_points(std::size_t index) const {
    const DataJob& data = job_.data[index];
    const WaveformResidualJob& waveform = *job_.estimate->waveform;
    const auto at =
        static_cast<std::size_t>(std::find(waveform.data.begin(), waveform.data.end(), index) - waveform.data.begin());
    double time = waveform.experiments[at].time;
    if (job_.model.system->kind() == models::Kind::forced)
        time = waveform.experiments[at].period *
               job_.model.system->period(data.with_own(job_.model.values), models::Clock::time);
    double step = data.simulation ? data.simulation->step : 0.0;
    if (!data.simulation && index < data_.experiments.size() && !data_.experiments[index].series.segments.empty()) {
        const Eigen::VectorXd& times = data_.experiments[index].series.segments.front().times;
        if (times.size() > 1) step = times[1] - times[0];
    }
    const double all = fitted_points(index);
    return time > 0.0 && step > 0.0 ? std::min(all, fitted_segments(index) * time / step) : all;
}

double JobAmounts::crossing() const {
    const bool map = job_.model.system->kind() == models::Kind::map;
    for (std::size_t i = 0; i < job_.data.size(); ++i)
        if (job_.data[i].sampling() == orbits::Series::Sampling::section)
            if (const FlowRate* known = rate(i)) return known->value;
    return seconds_per_crossing * static_cast<double>(job_.model.system->dimension()) * (map ? 0.01 : 1.0);
}

double JobAmounts::directions() const {
    const double free = job_.estimate ? static_cast<double>(job_.estimate->parameters.size()) : 0.0;
    return 1.0 + static_cast<double>(job_.model.system->dimension()) + free;
}

std::string JobAmounts::obstacle(const std::vector<std::size_t>& indices) const {
    for (const std::size_t index : indices)
        if (index < rates_.size() && !rates_[index].unknown.empty()) return rates_[index].unknown;
    return {};
}

}  // namespace orbid::apps
