#include "apps/stages/input_record.hpp"

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
                                      {}});
    }
    return layout;
}

}  // namespace

Inputs load_inputs(const Job& job, const DataJob& data) {
    if (!data.inputs) return {};
    const std::filesystem::path& file = data.inputs->file ? *data.inputs->file : data.file->path;
    const orbits::Series record = orbits::read_csv(file, input_layout(job, data));
    Inputs inputs;
    for (const orbits::Segment& segment : record.segments) {
        const auto points = static_cast<std::size_t>(segment.times.size());
        const auto count = static_cast<std::size_t>(segment.values.rows());
        try {
            inputs.push_back(std::make_shared<models::InputSignal>(
                std::span<const double>(segment.times.data(), points),
                std::span<const double>(segment.values.data(), count * points), count, data.inputs->interpolation));
        } catch (const models::DataError& error) {
            throw orbits::DataError(fmt::format("{}, segment {}: {}", file.string(), segment.label, error.what()));
        }
    }
    return inputs;
}

std::shared_ptr<const models::System> system_with(const Job& job, const Inputs& inputs) {
    return inputs.empty() ? job.model.system : job.model.system->with_input(inputs.front());
}

Inputs by_segment(const Inputs& inputs, std::size_t segments) {
    if (inputs.size() != 1) return inputs;
    return Inputs(segments, inputs.front());
}

}  // namespace orbid::apps
