#include "apps/stages/input_record.hpp"

#include <algorithm>

#include <fmt/format.h>

#include "apps/job/data_job.hpp"
#include "orbits/records/data_error.hpp"
#include "orbits/records/series_file.hpp"

namespace orbid::apps {

namespace {

orbits::TableLayout input_layout(const Job& job, const DataJob& data) {
    const InputJob& input = *data.inputs;
    orbits::TableLayout layout;
    layout.sampling = orbits::Series::Sampling::samples;
    layout.time = input.file ? input.time_column : data.file->time_column;
    layout.time_unit = input.file ? input.time_unit : data.file->time_unit;
    // One record, but for inputs beside the readings of several segments.
    if (!input.file) layout.segment = data.file->segment_column;
    layout.step = input.file ? 0.0 : data.file->step;
    layout.equidistant = false;
    layout.complete = true;
    layout.minimum_points = 2;
    for (const ColumnJob& column : input.columns) {
        const auto& entry = job.model.system->inputs()[static_cast<std::size_t>(column.coordinate)];
        layout.coordinates.push_back({{std::string(entry.name), std::string(entry.unit), false},
                                      column.column,
                                      column.unit,
                                      static_cast<double>(column.sign),
                                      column.offset,
                                      {},
                                      column.factor});
    }
    return layout;
}

std::shared_ptr<const models::InputSignal> signal(const orbits::Segment& segment, const std::filesystem::path& file,
                                                  const InputJob& input, double delay) {
    const Eigen::VectorXd times = segment.times.array() + delay;
    const auto points = static_cast<std::size_t>(segment.times.size());
    const auto count = static_cast<std::size_t>(segment.values.rows());
    try {
        return std::make_shared<models::InputSignal>(std::span<const double>(times.data(), points),
                                                     std::span<const double>(segment.values.data(), count * points),
                                                     count, input.interpolation);
    } catch (const models::DataError& error) {
        throw orbits::DataError(fmt::format("{}, segment {}: {}", file.string(), segment.label, error.what()));
    }
}

}  // namespace

LabelledInputs load_inputs(const Job& job, const DataJob& data, std::optional<double> delay) {
    if (!data.inputs) return {};
    const orbits::TableLayout layout = input_layout(job, data);
    const std::vector<std::filesystem::path> own{data.inputs->file.value_or("")};
    LabelledInputs inputs;
    for (const std::filesystem::path& file : data.inputs->file ? own : data.file->paths) {
        for (const orbits::Segment& segment : orbits::read_csv(file, layout).segments) {
            const std::string label = data.inputs->file ? segment.label : data.file->segment_name(file, segment.label);
            inputs.emplace_back(label, signal(segment, file, *data.inputs, delay.value_or(data.inputs->delay)));
        }
    }
    return inputs;
}

std::shared_ptr<const models::System> system_with(const Job& job, const LabelledInputs& inputs) {
    return inputs.empty() ? job.model.system : job.model.system->with_input(inputs.front().second);
}

Inputs by_segment(const LabelledInputs& inputs, const std::vector<orbits::Segment>& segments) {
    Inputs result;
    if (inputs.empty()) return result;
    for (const orbits::Segment& segment : segments) {
        const auto own = std::find_if(inputs.begin(), inputs.end(),
                                      [&segment](const auto& entry) { return entry.first == segment.label; });
        result.push_back(own != inputs.end() ? own->second : inputs.front().second);
    }
    return result;
}

}  // namespace orbid::apps
