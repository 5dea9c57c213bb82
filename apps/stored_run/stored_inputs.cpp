#include "apps/stored_run/stored_inputs.hpp"

#include <algorithm>

#include "apps/job/data_job.hpp"
#include "orbits/records/data_error.hpp"

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

}  // namespace orbid::apps
