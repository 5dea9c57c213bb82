#include "apps/estimation/estimate_waveform.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <stdexcept>

#include <fmt/format.h>

#include "apps/drawing/chart_picture.hpp"
#include "apps/drawing/waveform_plot.hpp"
#include "apps/job/data_job.hpp"
#include "estimator/interface/not_finite.hpp"
#include "identification/problem/estimated_values.hpp"
#include "models/definition/parameter.hpp"
#include "orbits/records/data_error.hpp"

namespace orbid::apps {

namespace {

using Eigen::Index;
using identification::scale_of;

double sd_of(const estimator::EstimatedScale& scale, const periodic::WaveformChannel& channel, double deviation,
             double predicted) {
    const double s = scale.value * deviation;
    if (std::holds_alternative<estimator::LogNormalErrors>(channel.distribution)) return s * std::abs(predicted);
    for (const estimator::Estimated& parameter : scale.shape)
        if (parameter.name == "relative") return std::hypot(s, parameter.value * predicted);
    return s;
}

}  // namespace

void add_waveform_rows(const Job& job, const ProblemWaveform& waveform, const estimator::Estimate& estimate,
                       const std::vector<estimator::BlockValue>& values, std::vector<ResidualRow>& rows) {
    const periodic::WaveformResidual& residual = *waveform.residual;
    for (std::size_t b = 0; b < values.size(); ++b) {
        if (values[b].e.size() == 0) continue;
        const periodic::WaveformRecord& record = residual.records()[b];
        const DataJob& data = job.data[waveform.places[b].experiment];
        for (Index i = 0; i < values[b].e.size(); ++i) {
            const auto& source = residual.sources(b)[static_cast<std::size_t>(i)];
            const auto& channel = residual.channels()[static_cast<std::size_t>(source.channel)];
            const auto& group = residual.groups()[static_cast<std::size_t>(source.channel)];
            const auto* scale = scale_of(estimate, group.name);
            const double observed = record.values(source.channel, source.sample);
            const double predicted = observed - values[b].e[i];
            const double deviation = channel.known_sds ? record.deviations(source.channel, source.sample) : 1.0;
            rows.push_back({data.name, waveform.residual->records()[b].label,
                            std::string(job.model.coordinate(channel.coordinate).name), record.times[source.sample],
                            observed, predicted,
                            scale != nullptr ? sd_of(*scale, channel, deviation, predicted) : estimator::nan_value});
        }
    }
}

void add_steady_states(const Job& job, const ProblemWaveform& waveform, const estimator::ActiveSet& active,
                       const Eigen::VectorXd& theta, const std::vector<Eigen::VectorXd>& latents,
                       const std::vector<Eigen::VectorXd>& sds, ResultContext& context) {
    const periodic::WaveformResidual& residual = *waveform.residual;
    const auto orbits = residual.solutions(active, theta);
    for (std::size_t b = 0; b < orbits.size(); ++b) {
        SteadyState state;
        state.experiment = job.data[waveform.places[b].experiment].name;
        state.segment = residual.records()[b].label;
        state.used = active.layout[b].active;
        state.orbit = orbits[b];
        const auto& unknowns = residual.unknowns(b);
        const auto sd_at = [&](Index unknown) {
            const auto at = std::find(unknowns.begin(), unknowns.end(), unknown);
            const bool known = b < sds.size() && sds[b].size() == std::ssize(unknowns);
            return at != unknowns.end() && known ? sds[b][at - unknowns.begin()] : estimator::nan_value;
        };
        const auto is_estimated = [&](Index unknown) {
            return std::count(unknowns.begin(), unknowns.end(), unknown) > 0;
        };
        const auto place = residual.alignment(b, latents[b]);
        state.phase = {"phase", "rad", models::wrapped(place.phase), sd_at(-1), is_estimated(-1)};
        // Several periods of the forcing: the phase says in which of them the record begins.
        if (residual.records()[b].period > 1) state.phase.value = place.phase;
        for (Index c = 0; c < place.offsets.size(); ++c) {
            const auto& coordinate = job.model.coordinate(residual.channels()[static_cast<std::size_t>(c)].coordinate);
            state.offsets.push_back({std::string(coordinate.name), std::string(coordinate.unit), place.offsets[c],
                                     sd_at(c), is_estimated(c)});
        }
        context.steady_states.push_back(std::move(state));
    }
}

std::vector<std::pair<std::string, std::string>> waveform_plots(const Job& job, const ProblemWaveform& waveform,
                                                                const estimator::ActiveSet& active,
                                                                const Eigen::VectorXd& theta,
                                                                const std::vector<Eigen::VectorXd>& latents) {
    constexpr std::size_t places = 401;
    const periodic::WaveformResidual& residual = *waveform.residual;
    const auto orbits = residual.solutions(active, theta);
    std::vector<WaveformPanel> panels(residual.channels().size());
    for (std::size_t b = 0; b < orbits.size(); ++b) {
        if (orbits[b].status != periodic::OrbitStatus::converged) continue;
        const periodic::WaveformRecord& record = residual.records()[b];
        const double time = orbits[b].time;
        const double share = residual.alignment(b, latents[b]).phase / (2.0 * std::numbers::pi * record.period);
        std::vector<double> shares(places);
        std::vector<double> times(places);
        for (std::size_t k = 0; k < places; ++k) {
            shares[k] = static_cast<double>(k) / static_cast<double>(places - 1);
            times[k] = (shares[k] - share) * time;
        }
        const Eigen::MatrixXd computed = residual.readings(active, b, theta, orbits[b], latents[b], times);
        if (computed.size() == 0) continue;
        Eigen::VectorXd at = record.times.array() / time + share;
        at = at.array() - at.array().floor();
        const auto list = [](const auto& numbers) { return std::vector<double>(numbers.begin(), numbers.end()); };
        for (std::size_t c = 0; c < panels.size(); ++c)
            panels[c].waveforms.push_back({record.label, list(at), list(record.values.row(static_cast<Index>(c))),
                                           shares, list(computed.row(static_cast<Index>(c)))});
    }
    std::vector<std::pair<std::string, std::string>> files;
    for (std::size_t c = 0; c < panels.size(); ++c) {
        if (panels[c].waveforms.empty()) continue;
        const auto index = static_cast<std::size_t>(residual.channels()[c].coordinate);
        const auto& entry = job.model.system->coordinates()[index];
        panels[c].coordinate = {
            std::string(entry.name), std::string(entry.unit),
            models::reads_angle(residual.records().front().sensor, job.model.system->coordinates(), index)};
        files.emplace_back(
            panels.size() == 1 ? std::string("waveform.svg") : fmt::format("waveform_{}.svg", entry.name),
            chart_svg(waveform_chart({panels[c]}), job.title.empty() ? "Steady states" : job.title, run_picture_style));
    }
    return files;
}

}  // namespace orbid::apps
