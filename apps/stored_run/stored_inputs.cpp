#include "apps/stored_run/stored_inputs.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

#include "apps/job/data_job.hpp"
#include "orbits/records/data_error.hpp"
#include "orbits/records/record_part.hpp"

namespace orbid::apps {

const models::InputSignal* StoredInputs::of(const std::string& segment) const {
    if (signals.size() == 1) return signals.front().second.get();
    const auto found =
        std::find_if(signals.begin(), signals.end(), [&](const auto& signal) { return signal.first == segment; });
    return found == signals.end() ? nullptr : found->second.get();
}

StoredInputs stored_inputs(const StoredRun& run, const std::string& experiment) {
    StoredInputs inputs;
    const auto described = run.experiments();
    const bool measured = std::any_of(described.begin(), described.end(),
                                      [](const StoredRun::Json* one) { return one->contains("inputs"); });
    if (!measured) return inputs;
    try {
        const Job job = stored_job(run);
        const auto data =
            std::find_if(job.data.begin(), job.data.end(), [&](const DataJob& one) { return one.name == experiment; });
        if (data == job.data.end()) return inputs;
        inputs.signals = load_inputs(job, *data);
        for (const models::Coordinate& input : job.model.system->inputs()) {
            inputs.names.emplace_back(input.name);
            inputs.units.emplace_back(input.unit == "1" ? std::string() : std::string(input.unit));
        }
    } catch (const orbits::DataError&) {
        return {};
    }
    return inputs;
}

orbits::Series covered_by_inputs(const Job& job, orbits::Series series, const Inputs& inputs) {
    if (inputs.empty() || series.sampling != orbits::Series::Sampling::samples) return series;
    const DataJob& data = job.data.front();
    const auto parameter = data.inputs->delay_parameter;
    const double delay = parameter ? data.with_own(job.model.values)[*parameter] : 0.0;  // a number is in the inputs
    const double second = data.sensor.type == models::Sensor::Type::angle_difference ? data.sensor.delay : 0.0;
    constexpr double rounding = 1e-12;
    for (std::size_t s = 0; s < series.segments.size(); ++s) {
        orbits::RecordPart known;
        known.begin = inputs[s]->first_time() + delay;
        known.end = inputs[s]->last_time() + delay - second;
        const double slack = rounding * (std::abs(known.begin) + std::abs(known.end));
        known.begin -= slack;
        known.end += slack;
        orbits::Series one = series;
        one.segments = {series.segments[s]};
        series.segments[s] = orbits::part_of(std::move(one), known, "segment " + series.segments[s].label).segments[0];
    }
    return series;
}

}  // namespace orbid::apps
