#include "apps/stages/recorded_series.hpp"

#include <algorithm>
#include <string>
#include <utility>

#include <fmt/format.h>

#include "apps/job/data_job.hpp"
#include "apps/job/estimate_job.hpp"
#include "orbits/records/data_error.hpp"
#include "orbits/records/series_file.hpp"

namespace orbid::apps {

namespace {

/// Header of the column with the sds of a coordinate's readings; empty: none is asked for.
std::string sd_column(const Job& job, std::size_t experiment, Eigen::Index coordinate) {
    const auto& observed = job.data[experiment].observe;
    if (!job.estimate || std::count(observed.begin(), observed.end(), coordinate) == 0) return {};
    const auto column_of = [&](const auto& residual) -> std::string {
        if (!residual || std::count(residual->data.begin(), residual->data.end(), experiment) == 0) return {};
        for (const ErrorJob& error : residual->errors)
            if (error.coordinate == coordinate) return error.sd_column;
        return {};
    };
    const std::string column = column_of(job.estimate->series);
    return column.empty() ? column_of(job.estimate->waveform) : column;
}

orbits::TableLayout table_layout(const Job& job, std::size_t index, const std::function<bool()>& interrupted) {
    const DataJob& data = job.data[index];
    const FileJob& file = *data.file;
    orbits::TableLayout layout;
    layout.sampling = file.sampling;
    layout.segment = file.segment_column;
    layout.time = file.time_column;
    layout.time_unit = file.time_unit;
    layout.step = file.step;
    layout.equidistant = file.evenly_spaced;
    layout.part = file.part;
    layout.nan_is_missing = file.nan_is_missing;
    layout.phase = job.section_phase;
    layout.minimum_points = 2;
    layout.interrupted = interrupted;
    for (const ColumnJob& column : file.columns)
        layout.coordinates.push_back({read_coordinate(job, data, static_cast<std::size_t>(column.coordinate)),
                                      column.column, column.unit, static_cast<double>(column.sign), column.offset,
                                      sd_column(job, index, column.coordinate), column.factor});
    return layout;
}

/// A file of orbid must hold what the job says.
void check_stored(const Job& job, const FileJob& file, const std::filesystem::path& path,
                  const orbits::Series& series) {
    using orbits::Series;
    if (series.sampling != file.sampling)
        throw orbits::DataError(fmt::format("{}: holds {}, but the job says \"kind\": \"{}\"", path.string(),
                                            file.sampling == Series::Sampling::section ? "samples" : "sections",
                                            file.sampling == Series::Sampling::section ? "section" : "samples"));
    for (const auto& coordinate : series.coordinates) {
        if (job.model.system->coordinate_index(coordinate.name) < 0)
            throw orbits::DataError(fmt::format("{}: coordinate \"{}\" is none of model {}", path.string(),
                                                coordinate.name, job.model.system->name()));
    }
}

orbits::Series stored_by_orbid(const Job& job, const FileJob& file, const std::filesystem::path& path,
                               const std::function<bool()>& interrupted) {
    orbits::Series series = orbits::read_hdf5(path, 2, interrupted);
    check_stored(job, file, path, series);
    return orbits::part_of(std::move(series), file.part, path.string());
}

/// Adds the segments of a further file of the same layout.
void append(orbits::Series further, const std::filesystem::path& path, orbits::Series& series) {
    const bool alike = std::equal(further.coordinates.begin(), further.coordinates.end(), series.coordinates.begin(),
                                  series.coordinates.end(),
                                  [](const auto& a, const auto& b) { return a.name == b.name && a.unit == b.unit; });
    if (!alike)
        throw orbits::DataError(fmt::format("{}: has other coordinates than the files before it", path.string()));
    std::move(further.segments.begin(), further.segments.end(), std::back_inserter(series.segments));
}

}  // namespace

/// A coordinate as the sensor of an experiment reads it.
orbits::SeriesCoordinate read_coordinate(const Job& job, const DataJob& data, std::size_t index) {
    const auto coordinates = job.model.system->coordinates();
    return {std::string(coordinates[index].name), std::string(coordinates[index].unit),
            models::reads_angle(data.sensor, coordinates, index)};
}

orbits::Series recorded_series(const Job& job, std::size_t index, const std::function<bool()>& interrupted) {
    const FileJob& file = *job.data[index].file;
    const orbits::TableLayout layout = table_layout(job, index, interrupted);
    std::optional<orbits::Series> joined;
    for (const std::filesystem::path& path : file.paths) {
        orbits::Series series =
            file.table ? orbits::read_csv(path, layout) : stored_by_orbid(job, file, path, interrupted);
        for (orbits::Segment& segment : series.segments)
            segment.label = file.segment_name(path, segment.label);
        if (joined) {
            append(std::move(series), path, *joined);
        } else {
            joined = std::move(series);
        }
    }
    return std::move(*joined);
}

std::unique_ptr<orbits::SeriesStream> recorded_stream(const Job& job, std::size_t index,
                                                      const std::function<bool()>& interrupted) {
    const FileJob& file = *job.data[index].file;
    std::vector<std::unique_ptr<orbits::SeriesStream>> records;
    for (const std::filesystem::path& path : file.paths) {
        records.push_back(file.table ? orbits::stream_csv(path, table_layout(job, index, interrupted))
                                     : orbits::stream_hdf5(path, interrupted));
        if (!file.table) check_stored(job, file, path, records.back()->header());
    }
    return orbits::joined(std::move(records));
}

}  // namespace orbid::apps
