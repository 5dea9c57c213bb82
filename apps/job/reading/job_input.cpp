#include "apps/job/job_parts.hpp"

namespace orbid::apps {

namespace {

using Sampling = orbits::Series::Sampling;

std::string names_of(std::span<const models::Coordinate> inputs) {
    std::string list;
    for (const models::Coordinate& input : inputs)
        list += (list.empty() ? "" : ", ") + std::string(input.name);
    return list;
}

/// Inputs without a file stand in the table of the data.
void check_source(const ObjectReader& object, const DataJob& data) {
    if (data.simulation) {
        object.self().report("inputs of a simulation need a \"file\" with their record");
    } else if (!data.file->table) {
        object.self().report(
            "inputs come from a table in text; beside an HDF5 file name their own: \"file\": \"inputs.csv\"");
    }
}

}  // namespace

void read_inputs(ObjectReader& object, const Job& job, DataJob& data) {
    const auto value = object.find("inputs");
    const auto interpolation = object.find("interpolation");
    const auto inputs = job.model.system ? job.model.system->inputs() : std::span<const models::Coordinate>{};
    if (!value) {
        if (interpolation) interpolation->report("belongs to \"inputs\", which are missing");
        if (!inputs.empty() && object.valid())
            object.self().report(fmt::format("the model {} reads measured inputs ({}): \"inputs\" is missing",
                                             job.model.name, names_of(inputs)));
        return;
    }
    if (job.model.system && inputs.empty()) {
        value->report(fmt::format("the model {}{} reads no measured inputs", job.model.name,
                                  job.model.variant.empty() ? "" : ", variant " + job.model.variant + ","));
        return;
    }
    if (data.sampling() == Sampling::section) value->report_later("measured inputs of a section series");
    InputJob input;
    ObjectReader columns(*value);
    const auto file = columns.find("file");
    if (file) {
        input.file = read_path(*file, job);
        input.sha256 = read_sha256(columns);
        if (const auto time = columns.find("time")) read_time(*time, input.time_column, input.time_unit);
    }
    for (std::size_t i = 0; i < inputs.size(); ++i) {
        const auto column = columns.require(inputs[i].name, "the column of this input");
        if (column) input.columns.push_back(read_column(*column, static_cast<Eigen::Index>(i), inputs[i]));
    }
    if (!file) check_source(columns, data);
    // Without the model its inputs would be called unknown.
    if (job.model.system) columns.finish();
    if (interpolation) {
        using Interpolation = models::InputSignal::Interpolation;
        input.interpolation =
            interpolation->choice({"linear", "cubic"}) == 1 ? Interpolation::cubic : Interpolation::linear;
    }
    data.inputs = std::move(input);
}

}  // namespace orbid::apps
