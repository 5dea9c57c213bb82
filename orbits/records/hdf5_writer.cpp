#include <algorithm>
#include <cerrno>
#include <stdexcept>
#include <string>
#include <system_error>
#include <vector>

#include <fmt/format.h>

#include "orbits/records/hdf5_library.hpp"
#include "orbits/records/series_file.hpp"

namespace orbid::orbits {
namespace {

/// Objects are created through this: every failure names file and object.
class Writer {
public:
    Writer(std::string file, const std::function<bool()>& interrupted)
        : file_(std::move(file)), interrupted_(interrupted) {}

    Hdf5Handle checked(hid_t id, herr_t (*close)(hid_t), const std::string& object) const {
        if (id < 0) fail(object);
        return {id, close};
    }
    void check(herr_t status, const std::string& object) const {
        if (status < 0) fail(object);
    }
    /// Closes an object: what was not on its way to the disk fails now.
    void finish(Hdf5Handle& made, const std::string& object) const {
        if (!made.closed()) fail(object);
    }
    [[noreturn]] void fail(const std::string& object) const {
        throw DataError(fmt::format("{}: {} cannot be written: {}", file_, object, reason()));
    }

    /// What the system said last: the library only says that it failed.
    static std::string reason() {
        return errno != 0 ? std::generic_category().message(errno) : "the HDF5 library failed";
    }

    void attribute(hid_t owner, const char* name, hid_t type, const Hdf5Handle& space, const void* data) const {
        Hdf5Handle made = checked(H5Acreate2(owner, name, type, space.id(), H5P_DEFAULT, H5P_DEFAULT), H5Aclose, name);
        check(H5Awrite(made.id(), type, data), name);
        finish(made, name);
    }

    /// Strings of one fixed length, padded with zeros: those of variable length live in a heap whose layout is HDF5's
    /// own affair.
    void strings(hid_t owner, const char* name, const std::vector<std::string>& values, bool scalar) const {
        std::size_t length = 1;
        for (const std::string& value : values)
            length = std::max(length, value.size());
        std::string padded;
        for (const std::string& value : values)
            padded += value + std::string(length - value.size(), '\0');
        const Hdf5Handle type = text_type(length, name);
        attribute(owner, name, type.id(), scalar ? single(name) : simple({values.size()}, name), padded.data());
    }

    Hdf5Handle single(const std::string& name) const { return checked(H5Screate(H5S_SCALAR), H5Sclose, name); }
    Hdf5Handle simple(const std::vector<hsize_t>& shape, const std::string& name) const {
        return checked(H5Screate_simple(static_cast<int>(shape.size()), shape.data(), nullptr), H5Sclose, name);
    }

    Hdf5Handle group(hid_t file, const char* name) const {
        const Hdf5Handle properties = untimed(H5P_GROUP_CREATE, name);
        return checked(H5Gcreate2(file, name, H5P_DEFAULT, properties.id(), H5P_DEFAULT), H5Gclose, name);
    }

    Hdf5Handle dataset(hid_t group, const std::string& name, const std::vector<hsize_t>& shape,
                       const double* data) const {
        const Hdf5Handle properties = untimed(H5P_DATASET_CREATE, name);
        const Hdf5Handle space = simple(shape, name);
        Hdf5Handle made = checked(
            H5Dcreate2(group, name.c_str(), H5T_IEEE_F64LE, space.id(), H5P_DEFAULT, properties.id(), H5P_DEFAULT),
            H5Dclose, name);
        if (!transfer_in_blocks(made, 0, shape, data, interrupted_, H5Dwrite)) fail(name);
        return made;
    }

    /// A text of any length: attributes end at 64 KiB.
    void text_dataset(hid_t group, const char* name, const std::string& text) const {
        const Hdf5Handle properties = untimed(H5P_DATASET_CREATE, name);
        const Hdf5Handle type = text_type(text.size(), name);
        Hdf5Handle made =
            checked(H5Dcreate2(group, name, type.id(), single(name).id(), H5P_DEFAULT, properties.id(), H5P_DEFAULT),
                    H5Dclose, name);
        check(H5Dwrite(made.id(), type.id(), H5S_ALL, H5S_ALL, H5P_DEFAULT, text.data()), name);
        finish(made, name);
    }

private:
    Hdf5Handle text_type(std::size_t length, const std::string& name) const {
        Hdf5Handle type = checked(H5Tcopy(H5T_C_S1), H5Tclose, name);
        check(H5Tset_size(type.id(), length), name);
        check(H5Tset_strpad(type.id(), H5T_STR_NULLPAD), name);
        check(H5Tset_cset(type.id(), H5T_CSET_UTF8), name);
        return type;
    }

    /// Properties of objects that do not store when they were made.
    Hdf5Handle untimed(hid_t kind, const std::string& name) const {
        Hdf5Handle properties = checked(H5Pcreate(kind), H5Pclose, name);
        check(H5Pset_obj_track_times(properties.id(), false), name);
        return properties;
    }

    std::string file_;
    const std::function<bool()>& interrupted_;
};

void validate_series(const Series& series) {
    if (series.coordinates.empty()) throw std::invalid_argument("series: at least one coordinate is needed");
    const bool timed = series.timed();
    for (const Segment& segment : series.segments) {
        if (segment.values.rows() != series.dimension()) {
            throw std::invalid_argument(fmt::format("segment \"{}\" has {} rows of values, the series {} coordinates",
                                                    segment.label, segment.values.rows(), series.dimension()));
        }
        if (segment.times.size() != (timed ? segment.values.cols() : 0)) {
            throw std::invalid_argument(fmt::format("segment \"{}\" has {} times and {} points{}", segment.label,
                                                    segment.times.size(), segment.values.cols(),
                                                    timed ? "" : "; all crossings of a section have times, or none"));
        }
    }
}

}  // namespace

void write_hdf5(const std::filesystem::path& file, const Series& series, const std::function<bool()>& interrupted) {
    validate_series(series);
    const Hdf5Silence silence;
    const Writer write(file.string(), interrupted);
    const bool sampled = series.sampling == Series::Sampling::samples;

    errno = 0;
    const hid_t created = H5Fcreate(file.c_str(), H5F_ACC_TRUNC, H5P_DEFAULT, H5P_DEFAULT);
    if (created < 0)
        throw DataError(fmt::format("{}: cannot be opened for writing: {}", file.string(), Writer::reason()));
    Hdf5Handle out(created, H5Fclose);

    std::vector<std::string> names;
    std::vector<std::string> units;
    std::vector<signed char> angles;
    for (const SeriesCoordinate& coordinate : series.coordinates) {
        names.push_back(coordinate.name);
        units.push_back(coordinate.unit);
        angles.push_back(coordinate.angle ? 1 : 0);
    }
    Hdf5Handle root = write.checked(H5Gopen2(out.id(), "/", H5P_DEFAULT), H5Gclose, "/");
    write.strings(root.id(), "format", {"orbid-series/1"}, true);
    write.strings(root.id(), "sampling", {sampled ? "samples" : "section"}, true);
    write.attribute(root.id(), "phase", H5T_NATIVE_DOUBLE, write.single("phase"), &series.phase);
    write.strings(root.id(), "coordinates", names, false);
    write.strings(root.id(), "units", units, false);
    write.attribute(root.id(), "angles", H5T_NATIVE_SCHAR, write.simple({angles.size()}, "angles"), angles.data());

    if (!series.origin.empty()) write.text_dataset(out.id(), "origin", series.origin);

    Hdf5Handle segments = write.group(out.id(), "segments");
    const bool timed = series.timed();
    Hdf5Handle times = timed ? write.group(out.id(), "times") : Hdf5Handle();
    for (std::size_t s = 0; s < series.segments.size(); ++s) {
        const Segment& segment = series.segments[s];
        const std::string name = fmt::format("{:06}", s);
        const auto points = static_cast<hsize_t>(segment.values.cols());
        // Column-major (n, points) is row-major (points, n): one row per point, without copying.
        Hdf5Handle values = write.dataset(segments.id(), name, {points, static_cast<hsize_t>(segment.values.rows())},
                                          segment.values.data());
        write.strings(values.id(), "label", {segment.label}, true);
        write.finish(values, name);
        if (!timed) continue;
        Hdf5Handle at = write.dataset(times.id(), name, {points}, segment.times.data());
        write.finish(at, "times/" + name);
    }
    write.finish(times, "times");
    write.finish(segments, "segments");
    write.finish(root, "/");
    write.check(H5Fflush(out.id(), H5F_SCOPE_GLOBAL), "the file");
    write.finish(out, "the file");
}

}  // namespace orbid::orbits
