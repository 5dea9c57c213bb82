#include <cmath>
#include <string>
#include <vector>

#include <fmt/format.h>

#include "orbits/records/hdf5_objects.hpp"
#include "orbits/records/series_file.hpp"

namespace orbid::orbits {
namespace {

Segment read_segment(const Hdf5Reader& read, hid_t file, std::size_t index, Eigen::Index dimension, bool timed) {
    Segment segment;
    const std::string path = fmt::format("segments/{:06}", index);
    const Hdf5Handle values = read.open_dataset(file, path);
    const auto shape = read.shape(values);
    if (shape.size() != 2 || shape[1] != static_cast<hsize_t>(dimension)) {
        read.fail(fmt::format("dataset \"{}\" has shape ({}), must be (points, {}): one column per coordinate", path,
                              fmt::join(shape, ", "), dimension));
    }
    read.need_room_for_numbers(path, shape);
    const auto points = static_cast<Eigen::Index>(shape[0]);
    segment.values.resize(dimension, points);
    read.values(values, path, {segment.values.data(), static_cast<std::size_t>(segment.values.size())});
    for (Eigen::Index k = 0; k < points; ++k) {
        for (Eigen::Index i = 0; i < dimension; ++i)
            if (std::isinf(segment.values(i, k)))
                read.fail(fmt::format("dataset \"{}\", point {}: infinite value; a missing sample is nan", path, k));
    }
    segment.label = read.text(values.id(), "label");
    if (!timed) return segment;

    const std::string times_path = fmt::format("times/{:06}", index);
    const Hdf5Handle times = read.open_dataset(file, times_path);
    const auto times_shape = read.shape(times);
    if (times_shape.size() != 1 || times_shape[0] != shape[0]) {
        read.fail(fmt::format("dataset \"{}\" has shape ({}), must be ({}): one time per point", times_path,
                              fmt::join(times_shape, ", "), points));
    }
    segment.times.resize(points);
    read.values(times, times_path, {segment.times.data(), static_cast<std::size_t>(points)});
    for (Eigen::Index k = 0; k < points; ++k)
        if (!std::isfinite(segment.times[k]) || (k > 0 && !(segment.times[k] > segment.times[k - 1])))
            read.fail(fmt::format("dataset \"{}\", point {}: times must be finite and ascend", times_path, k));
    return segment;
}

}  // namespace

Series read_hdf5(const std::filesystem::path& file, std::size_t minimum_points,
                 const std::function<bool()>& interrupted) {
    const Hdf5Reader read(file, interrupted);
    const Hdf5Silence silence;
    const Hdf5Handle opened = opened_file(read, file);
    const Hdf5Handle root(H5Gopen2(opened.id(), "/", H5P_DEFAULT), H5Gclose);
    Series series;
    read_header(read, root.id(), series);
    // Crossings of a section may have been timed.
    const bool timed = series.sampling == Series::Sampling::samples || H5Lexists(opened.id(), "times", H5P_DEFAULT) > 0;
    const std::size_t segments = read.members(opened.id(), "segments");
    for (std::size_t s = 0; s < segments; ++s)
        series.segments.push_back(read_segment(read, opened.id(), s, series.dimension(), timed));
    if (series.size() < minimum_points)
        read.fail(fmt::format("has {} points, at least {} are needed", series.size(), minimum_points));
    return series;
}

}  // namespace orbid::orbits
