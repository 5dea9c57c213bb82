#pragma once

#include <algorithm>
#include <cerrno>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <string>
#include <system_error>
#include <utility>
#include <vector>

#include <fmt/format.h>

#include "orbits/records/data_error.hpp"
#include "orbits/records/data_file.hpp"
#include "orbits/records/hdf5_library.hpp"
#include "orbits/records/hdf5_own_links.hpp"
#include "orbits/records/series.hpp"

namespace orbid::orbits {

inline constexpr const char* known_format = "orbid-series/1";

/// Objects of a file are read through this: every failure names file, object and rule.
class Hdf5Reader {
public:
    /// @param interrupted  asked while numbers are read; must outlive the reader
    /// @throws DataError if there is no such file, or it is none that holds data
    Hdf5Reader(const std::filesystem::path& file, const std::function<bool()>& interrupted)
        : file_(file.string()), bytes_(require_data_file(file)), interrupted_(interrupted) {}

    [[noreturn]] void fail(const std::string& what) const { throw DataError(fmt::format("{}: {}", file_, what)); }

    /// The same of what the library could not do: with the reason of the system, if it had one.
    [[noreturn]] void fail(const std::string& what, const std::string& otherwise) const {
        if (const std::string file = links_.refused(); !file.empty())
            fail(fmt::format("it links to another file ({}); only what is in the file itself is read", file));
        fail(fmt::format("{}{}", what, errno != 0 ? ": " + std::generic_category().message(errno) : otherwise));
    }

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
        if (H5Lexists(file, name.c_str(), links_.links()) <= 0)
            fail(fmt::format("group \"{}\" is missing; format {} needs it", name, known_format));
        errno = 0;
        const Hdf5Handle group(H5Gopen2(file, name.c_str(), links_.groups()), H5Gclose);
        H5G_info_t info{};
        if (!group.valid() || H5Gget_info(group.id(), &info) < 0) fail(fmt::format("\"{}\"", name), " must be a group");
        return static_cast<std::size_t>(info.nlinks);
    }

    Hdf5Handle open_dataset(hid_t file, const std::string& path) const {
        errno = 0;
        if (H5Lexists(file, path.c_str(), links_.links()) <= 0)
            fail(fmt::format("dataset \"{}\"", path), " is missing; segments are numbered from 000000 without gaps");
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
        if (H5Lexists(file, path.c_str(), links_.links()) <= 0) return {};
        const Hdf5Handle dataset = existing_dataset(file, path);
        const Hdf5Handle type(H5Dget_type(dataset.id()), H5Tclose);
        const Hdf5Handle space(H5Dget_space(dataset.id()), H5Sclose);
        if (H5Tget_class(type.id()) != H5T_STRING || H5Tis_variable_str(type.id()) > 0 ||
            H5Sget_simple_extent_npoints(space.id()) != 1)
            fail(fmt::format("dataset \"{}\" must hold one text of fixed length", path));
        need_room(fmt::format("dataset \"{}\"", path), 1, H5Tget_size(type.id()), 1.0);
        std::string text(H5Tget_size(type.id()), '\0');
        errno = 0;
        if (H5Dread(dataset.id(), type.id(), H5S_ALL, H5S_ALL, H5P_DEFAULT, text.data()) < 0)
            fail(fmt::format("dataset \"{}\" cannot be read", path), damaged);
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

    /// `count` rows from `first` on, of a dataset of this shape.
    void rows(const Hdf5Handle& dataset, const std::string& path, std::vector<hsize_t> shape, hsize_t first,
              hsize_t count, double* values) const {
        const Hdf5Handle type(H5Dget_type(dataset.id()), H5Tclose);
        if (H5Tget_class(type.id()) != H5T_FLOAT) fail(fmt::format("dataset \"{}\" must hold floating numbers", path));
        if (count == 0) return;
        shape[0] = count;
        errno = 0;
        if (!transfer_in_blocks(dataset, first, shape, values, interrupted_, H5Dread))
            fail(fmt::format("dataset \"{}\" cannot be read", path), damaged);
    }

private:
    Hdf5Handle existing_dataset(hid_t file, const std::string& path) const {
        errno = 0;
        Hdf5Handle dataset(H5Dopen2(file, path.c_str(), links_.datasets()), H5Dclose);
        if (!dataset.valid()) fail(fmt::format("\"{}\"", path), " must be a dataset");
        if (!is_stored_inside(dataset))
            fail(fmt::format("dataset \"{}\" has its numbers in other files; only what is in the file itself is read",
                             path));
        return dataset;
    }

    /// The number of entries, each of so many bytes at least: no more than the file can hold.
    std::size_t count_of(const Hdf5Handle& attribute, const std::string& name, std::size_t bytes) const {
        const Hdf5Handle space(H5Aget_space(attribute.id()), H5Sclose);
        const auto count = static_cast<std::size_t>(std::max<hssize_t>(H5Sget_simple_extent_npoints(space.id()), 0));
        need_room(fmt::format("attribute \"{}\"", name), count, bytes, 1.0);
        return count;
    }

    static constexpr const char* damaged = "; the file is damaged";

    std::string file_;
    std::uintmax_t bytes_;
    const std::function<bool()>& interrupted_;
    Hdf5OwnLinks links_;
};

/// Everything about the record but its segments.
inline void read_header(const Hdf5Reader& read, hid_t file, Series& series) {
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

/// The file, opened for reading while HDF5 is silent (Hdf5Silence).
/// @throws DataError
inline Hdf5Handle opened_file(const Hdf5Reader& read, const std::filesystem::path& file) {
    errno = 0;
    if (H5Fis_hdf5(file.c_str()) <= 0) read.fail("is not an HDF5 file, or cannot be read", "");
    errno = 0;
    Hdf5Handle opened(H5Fopen(file.c_str(), H5F_ACC_RDONLY, H5P_DEFAULT), H5Fclose);
    if (!opened.valid()) read.fail("cannot be opened as an HDF5 file", "; it is damaged or open elsewhere for writing");
    return opened;
}

}  // namespace orbid::orbits
