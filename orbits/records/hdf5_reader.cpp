#include <algorithm>
#include <cmath>
#include <span>
#include <string>
#include <vector>

#include <fmt/format.h>

#include "orbits/records/data_file.hpp"
#include "orbits/records/hdf5_library.hpp"
#include "orbits/records/series_file.hpp"

namespace orbid::orbits {
namespace {

constexpr const char* known_format = "orbid-series/1";

/// Objects are read through this: every failure names file, object and rule.
class Reader {
public:
    Reader(std::string file, std::uintmax_t bytes, const std::function<bool()>& interrupted)
        : file_(std::move(file)), bytes_(bytes), interrupted_(interrupted) {}

    [[noreturn]] void fail(const std::string& what) const { throw DataError(fmt::format("{}: {}", file_, what)); }

    Hdf5Handle open_attribute(hid_t owner, const std::string& name) const {
        if (H5Aexists(owner, name.c_str()) <= 0)
            fail(fmt::format("attribute \"{}\" is missing; format {} needs it", name, known_format));
        Hdf5Handle attribute(H5Aopen(owner, name.c_str(), H5P_DEFAULT), H5Aclose);
        if (!attribute.valid()) fail(fmt::format("attribute \"{}\" cannot be opened", name));
        return attribute;
    }

    /// Strings of fixed or variable length.
    std::vector<std::string> strings(hid_t owner, const std::string& name) const {
        const Hdf5Handle attribute = open_attribute(owner, name);
        const Hdf5Handle type(H5Aget_type(attribute.id()), H5Tclose);
        if (H5Tget_class(type.id()) != H5T_STRING) fail(fmt::format("attribute \"{}\" must hold text", name));
        const std::size_t count = count_of(attribute, name, 1);
        std::vector<std::string> values;
        bool good = true;
        if (H5Tis_variable_str(type.id()) > 0) {
            std::vector<char*> pointers(count, nullptr);
            const Hdf5Handle space(H5Aget_space(attribute.id()), H5Sclose);
            good = H5Aread(attribute.id(), type.id(), pointers.data()) >= 0;
            for (const char* pointer : pointers)
                values.emplace_back(!good || pointer == nullptr ? "" : pointer);
            if (good) H5Dvlen_reclaim(type.id(), space.id(), H5P_DEFAULT, pointers.data());
        } else {
            const std::size_t length = H5Tget_size(type.id());
            (void)count_of(attribute, name, length);
            std::string padded(count * length, '\0');
            good = H5Aread(attribute.id(), type.id(), padded.data()) >= 0;
            for (std::size_t i = 0; i < count; ++i) {
                const std::string value = padded.substr(i * length, length);
                values.push_back(value.substr(0, value.find('\0')));
            }
        }
        if (!good) fail(fmt::format("attribute \"{}\" cannot be read", name));
        return values;
    }

    std::string text(hid_t owner, const std::string& name) const {
        const auto values = strings(owner, name);
        if (values.size() != 1) fail(fmt::format("attribute \"{}\" must hold one text", name));
        return values.front();
    }

    std::vector<double> numbers(hid_t owner, const std::string& name) const {
        const Hdf5Handle attribute = open_attribute(owner, name);
        const Hdf5Handle type(H5Aget_type(attribute.id()), H5Tclose);
        const auto kind = H5Tget_class(type.id());
        std::vector<double> values(count_of(attribute, name, 1));
        if ((kind != H5T_FLOAT && kind != H5T_INTEGER) || H5Aread(attribute.id(), H5T_NATIVE_DOUBLE, values.data()) < 0)
            fail(fmt::format("attribute \"{}\" must hold numbers", name));
        return values;
    }

    /// Number of objects in a group; the group must exist.
    std::size_t members(hid_t file, const std::string& name) const {
        if (H5Lexists(file, name.c_str(), H5P_DEFAULT) <= 0)
            fail(fmt::format("group \"{}\" is missing; format {} needs it", name, known_format));
        const Hdf5Handle group(H5Gopen2(file, name.c_str(), H5P_DEFAULT), H5Gclose);
        H5G_info_t info{};
        if (!group.valid() || H5Gget_info(group.id(), &info) < 0) fail(fmt::format("\"{}\" must be a group", name));
        return static_cast<std::size_t>(info.nlinks);
    }

    Hdf5Handle open_dataset(hid_t file, const std::string& path) const {
        if (H5Lexists(file, path.c_str(), H5P_DEFAULT) <= 0)
            fail(fmt::format("dataset \"{}\" is missing; segments are numbered from 000000 without gaps", path));
        return existing_dataset(file, path);
    }

    std::vector<hsize_t> shape(const Hdf5Handle& dataset) const {
        const Hdf5Handle space(H5Dget_space(dataset.id()), H5Sclose);
        const int rank = H5Sget_simple_extent_ndims(space.id());
        std::vector<hsize_t> sizes(rank > 0 ? static_cast<std::size_t>(rank) : 0);
        if (rank > 0) H5Sget_simple_extent_dims(space.id(), sizes.data(), nullptr);
        return sizes;
    }

    /// The text of a dataset; empty when there is none.
    std::string text_dataset(hid_t file, const std::string& path) const {
        if (H5Lexists(file, path.c_str(), H5P_DEFAULT) <= 0) return {};
        const Hdf5Handle dataset = existing_dataset(file, path);
        const Hdf5Handle type(H5Dget_type(dataset.id()), H5Tclose);
        const Hdf5Handle space(H5Dget_space(dataset.id()), H5Sclose);
        if (H5Tget_class(type.id()) != H5T_STRING || H5Tis_variable_str(type.id()) > 0 ||
            H5Sget_simple_extent_npoints(space.id()) != 1)
            fail(fmt::format("dataset \"{}\" must hold one text of fixed length", path));
        need_room(fmt::format("dataset \"{}\"", path), 1, H5Tget_size(type.id()), 1.0);
        std::string text(H5Tget_size(type.id()), '\0');
        if (H5Dread(dataset.id(), type.id(), H5S_ALL, H5S_ALL, H5P_DEFAULT, text.data()) < 0)
            fail(fmt::format("dataset \"{}\" cannot be read; the file is damaged", path));
        text.resize(std::min(text.find('\0'), text.size()));
        return text;
    }

    /// Refuses an object that claims more than the file can hold: a wrong number must not exhaust the memory.
    /// @param compression  how many bytes one of the file may stand for.
    void need_room(const std::string& object, std::size_t count, std::size_t bytes, double compression) const {
        const double needed = static_cast<double>(count) * static_cast<double>(bytes);
        if (needed > compression * static_cast<double>(bytes_))
            fail(fmt::format("{} has {} entries, more than a file of {} bytes can hold; the file is damaged", object,
                             count, bytes_));
    }
    /// The same for a dataset of doubles. deflate, the usual compression, makes 1 of 1032 bytes at best (RFC 1951).
    void need_room_for_numbers(const std::string& path, const std::vector<hsize_t>& shape) const {
        constexpr double best_deflate = 1032.0;
        double count = 1.0;
        for (const hsize_t size : shape)
            count *= static_cast<double>(size);
        constexpr double most = 1e18;
        need_room(fmt::format("dataset \"{}\"", path), static_cast<std::size_t>(std::min(count, most)), sizeof(double),
                  best_deflate);
    }

    /// A whole dataset of numbers.
    void values(const Hdf5Handle& dataset, const std::string& path, std::span<double> values) const {
        const Hdf5Handle type(H5Dget_type(dataset.id()), H5Tclose);
        if (H5Tget_class(type.id()) != H5T_FLOAT) fail(fmt::format("dataset \"{}\" must hold floating numbers", path));
        if (values.empty()) return;
        if (!transfer_in_blocks(dataset, shape(dataset), values.data(), interrupted_, H5Dread))
            fail(fmt::format("dataset \"{}\" cannot be read; the file is damaged", path));
    }

private:
    Hdf5Handle existing_dataset(hid_t file, const std::string& path) const {
        Hdf5Handle dataset(H5Dopen2(file, path.c_str(), H5P_DEFAULT), H5Dclose);
        if (!dataset.valid()) fail(fmt::format("\"{}\" must be a dataset", path));
        return dataset;
    }

    /// The number of entries, each of so many bytes at least: no more than the file can hold.
    std::size_t count_of(const Hdf5Handle& attribute, const std::string& name, std::size_t bytes) const {
        const Hdf5Handle space(H5Aget_space(attribute.id()), H5Sclose);
        const auto count = static_cast<std::size_t>(std::max<hssize_t>(H5Sget_simple_extent_npoints(space.id()), 0));
        need_room(fmt::format("attribute \"{}\"", name), count, bytes, 1.0);
        return count;
    }

    std::string file_;
    std::uintmax_t bytes_;
    const std::function<bool()>& interrupted_;
};

void read_header(const Reader& read, hid_t file, Series& series) {
    const std::string format = read.text(file, "format");
    if (format != known_format)
        read.fail(fmt::format("attribute \"format\" is \"{}\", only \"{}\" can be read", format, known_format));
    const std::string sampling = read.text(file, "sampling");
    if (sampling != "section" && sampling != "samples")
        read.fail(fmt::format("attribute \"sampling\" is \"{}\", must be \"section\" or \"samples\"", sampling));
    series.sampling = sampling == "section" ? Series::Sampling::section : Series::Sampling::samples;
    const auto phase = read.numbers(file, "phase");
    if (phase.size() != 1 || !std::isfinite(phase.front())) read.fail("attribute \"phase\" must be one finite number");
    series.phase = phase.front();
    series.origin = read.text_dataset(file, "origin");
    const auto names = read.strings(file, "coordinates");
    const auto units = read.strings(file, "units");
    const auto angles = read.numbers(file, "angles");
    if (names.empty() || units.size() != names.size() || angles.size() != names.size()) {
        read.fail(
            fmt::format("attributes \"coordinates\", \"units\" and \"angles\" have {}, {} and {} entries; equal "
                        "numbers, at least one, are needed",
                        names.size(), units.size(), angles.size()));
    }
    for (std::size_t i = 0; i < names.size(); ++i)
        series.coordinates.push_back({names[i], units[i], angles[i] != 0.0});
}

Segment read_segment(const Reader& read, hid_t file, std::size_t index, Eigen::Index dimension, bool timed) {
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
    const Reader read(file.string(), require_data_file(file), interrupted);
    const Hdf5Silence silence;
    if (H5Fis_hdf5(file.c_str()) <= 0) read.fail("is not an HDF5 file, or cannot be read");
    const Hdf5Handle opened(H5Fopen(file.c_str(), H5F_ACC_RDONLY, H5P_DEFAULT), H5Fclose);
    if (!opened.valid()) read.fail("cannot be opened as an HDF5 file; it is damaged or open elsewhere for writing");
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
