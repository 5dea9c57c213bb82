#pragma once

#include <algorithm>
#include <functional>
#include <utility>
#include <vector>

#include <hdf5.h>

#include "models/system/stopped.hpp"
#include "orbits/records/library_function.hpp"

namespace orbid::orbits {

/// The address of a function or variable of the HDF5 library, which is loaded on first use. Most commands read no HDF5
/// file. The library and its dependencies (network transfer, cryptography) take three times as long to load as the rest
/// of the program.
/// @throws DataError naming library and reason when it cannot be loaded.
[[nodiscard]] void* hdf5_symbol(const char* name);

template <class Function>
using Hdf5Function = LibraryFunction<Function, hdf5_symbol>;

/// An identifier that the library fills in when it is opened, likewise. Behind the macros of the header.
class Hdf5Identifier {
public:
    explicit constexpr Hdf5Identifier(const char* name) : name_(name) {}
    operator hid_t() const { return *static_cast<hid_t*>(hdf5_symbol(name_)); }

private:
    const char* name_;
};

inline constexpr Hdf5Function<decltype(::H5Aclose)> H5Aclose{"H5Aclose"};
inline constexpr Hdf5Function<decltype(::H5Acreate2)> H5Acreate2{"H5Acreate2"};
inline constexpr Hdf5Function<decltype(::H5Aexists)> H5Aexists{"H5Aexists"};
inline constexpr Hdf5Function<decltype(::H5Aget_space)> H5Aget_space{"H5Aget_space"};
inline constexpr Hdf5Function<decltype(::H5Aget_type)> H5Aget_type{"H5Aget_type"};
inline constexpr Hdf5Function<decltype(::H5Aopen)> H5Aopen{"H5Aopen"};
inline constexpr Hdf5Function<decltype(::H5Aread)> H5Aread{"H5Aread"};
inline constexpr Hdf5Function<decltype(::H5Awrite)> H5Awrite{"H5Awrite"};
inline constexpr Hdf5Function<decltype(::H5Dclose)> H5Dclose{"H5Dclose"};
inline constexpr Hdf5Function<decltype(::H5Dcreate2)> H5Dcreate2{"H5Dcreate2"};
inline constexpr Hdf5Function<decltype(::H5Dget_create_plist)> H5Dget_create_plist{"H5Dget_create_plist"};
inline constexpr Hdf5Function<decltype(::H5Dget_space)> H5Dget_space{"H5Dget_space"};
inline constexpr Hdf5Function<decltype(::H5Dget_type)> H5Dget_type{"H5Dget_type"};
inline constexpr Hdf5Function<decltype(::H5Dopen2)> H5Dopen2{"H5Dopen2"};
inline constexpr Hdf5Function<decltype(::H5Dread)> H5Dread{"H5Dread"};
inline constexpr Hdf5Function<decltype(::H5Dvlen_reclaim)> H5Dvlen_reclaim{"H5Dvlen_reclaim"};
inline constexpr Hdf5Function<decltype(::H5Dwrite)> H5Dwrite{"H5Dwrite"};
inline constexpr Hdf5Function<decltype(::H5Eget_auto2)> H5Eget_auto2{"H5Eget_auto2"};
inline constexpr Hdf5Function<decltype(::H5Eset_auto2)> H5Eset_auto2{"H5Eset_auto2"};
inline constexpr Hdf5Function<decltype(::H5Fclose)> H5Fclose{"H5Fclose"};
inline constexpr Hdf5Function<decltype(::H5Fcreate)> H5Fcreate{"H5Fcreate"};
inline constexpr Hdf5Function<decltype(::H5Fflush)> H5Fflush{"H5Fflush"};
inline constexpr Hdf5Function<decltype(::H5Fis_hdf5)> H5Fis_hdf5{"H5Fis_hdf5"};
inline constexpr Hdf5Function<decltype(::H5Fopen)> H5Fopen{"H5Fopen"};
inline constexpr Hdf5Function<decltype(::H5Gclose)> H5Gclose{"H5Gclose"};
inline constexpr Hdf5Function<decltype(::H5Gcreate2)> H5Gcreate2{"H5Gcreate2"};
inline constexpr Hdf5Function<decltype(::H5Gget_info)> H5Gget_info{"H5Gget_info"};
inline constexpr Hdf5Function<decltype(::H5Gopen2)> H5Gopen2{"H5Gopen2"};
inline constexpr Hdf5Function<decltype(::H5Lexists)> H5Lexists{"H5Lexists"};
inline constexpr Hdf5Function<decltype(::H5Pclose)> H5Pclose{"H5Pclose"};
inline constexpr Hdf5Function<decltype(::H5Pcreate)> H5Pcreate{"H5Pcreate"};
inline constexpr Hdf5Function<decltype(::H5Pget_external_count)> H5Pget_external_count{"H5Pget_external_count"};
inline constexpr Hdf5Function<decltype(::H5Pget_layout)> H5Pget_layout{"H5Pget_layout"};
inline constexpr Hdf5Function<decltype(::H5Pset_elink_cb)> H5Pset_elink_cb{"H5Pset_elink_cb"};
inline constexpr Hdf5Function<decltype(::H5Pset_obj_track_times)> H5Pset_obj_track_times{"H5Pset_obj_track_times"};
inline constexpr Hdf5Function<decltype(::H5Sclose)> H5Sclose{"H5Sclose"};
inline constexpr Hdf5Function<decltype(::H5Screate)> H5Screate{"H5Screate"};
inline constexpr Hdf5Function<decltype(::H5Screate_simple)> H5Screate_simple{"H5Screate_simple"};
inline constexpr Hdf5Function<decltype(::H5Sget_simple_extent_dims)> H5Sget_simple_extent_dims{
    "H5Sget_simple_extent_dims"};
inline constexpr Hdf5Function<decltype(::H5Sget_simple_extent_ndims)> H5Sget_simple_extent_ndims{
    "H5Sget_simple_extent_ndims"};
inline constexpr Hdf5Function<decltype(::H5Sget_simple_extent_npoints)> H5Sget_simple_extent_npoints{
    "H5Sget_simple_extent_npoints"};
inline constexpr Hdf5Function<decltype(::H5Sselect_hyperslab)> H5Sselect_hyperslab{"H5Sselect_hyperslab"};
inline constexpr Hdf5Function<decltype(::H5Tclose)> H5Tclose{"H5Tclose"};
inline constexpr Hdf5Function<decltype(::H5Tcopy)> H5Tcopy{"H5Tcopy"};
inline constexpr Hdf5Function<decltype(::H5Tget_class)> H5Tget_class{"H5Tget_class"};
inline constexpr Hdf5Function<decltype(::H5Tget_size)> H5Tget_size{"H5Tget_size"};
inline constexpr Hdf5Function<decltype(::H5Tis_variable_str)> H5Tis_variable_str{"H5Tis_variable_str"};
inline constexpr Hdf5Function<decltype(::H5Tset_cset)> H5Tset_cset{"H5Tset_cset"};
inline constexpr Hdf5Function<decltype(::H5Tset_size)> H5Tset_size{"H5Tset_size"};
inline constexpr Hdf5Function<decltype(::H5Tset_strpad)> H5Tset_strpad{"H5Tset_strpad"};
inline constexpr Hdf5Function<decltype(::H5check_version)> H5check_version{"H5check_version"};
inline constexpr Hdf5Function<decltype(::H5open)> H5open{"H5open"};

inline constexpr Hdf5Identifier H5P_CLS_DATASET_ACCESS_ID_g{"H5P_CLS_DATASET_ACCESS_ID_g"};
inline constexpr Hdf5Identifier H5P_CLS_DATASET_CREATE_ID_g{"H5P_CLS_DATASET_CREATE_ID_g"};
inline constexpr Hdf5Identifier H5P_CLS_GROUP_ACCESS_ID_g{"H5P_CLS_GROUP_ACCESS_ID_g"};
inline constexpr Hdf5Identifier H5P_CLS_GROUP_CREATE_ID_g{"H5P_CLS_GROUP_CREATE_ID_g"};
inline constexpr Hdf5Identifier H5P_CLS_LINK_ACCESS_ID_g{"H5P_CLS_LINK_ACCESS_ID_g"};
inline constexpr Hdf5Identifier H5T_C_S1_g{"H5T_C_S1_g"};
inline constexpr Hdf5Identifier H5T_IEEE_F64LE_g{"H5T_IEEE_F64LE_g"};
inline constexpr Hdf5Identifier H5T_NATIVE_DOUBLE_g{"H5T_NATIVE_DOUBLE_g"};
inline constexpr Hdf5Identifier H5T_NATIVE_SCHAR_g{"H5T_NATIVE_SCHAR_g"};

/// Owner of one HDF5 identifier: closes it with the function of its kind.
class Hdf5Handle {
public:
    Hdf5Handle() = default;
    Hdf5Handle(hid_t id, herr_t (*close)(hid_t)) : id_(id), close_(close) {}
    Hdf5Handle(Hdf5Handle&& other) noexcept : id_(std::exchange(other.id_, -1)), close_(other.close_) {}
    Hdf5Handle& operator=(Hdf5Handle&& other) noexcept {
        std::swap(id_, other.id_);
        std::swap(close_, other.close_);
        return *this;
    }
    ~Hdf5Handle() {
        if (id_ >= 0) close_(id_);
    }

    /// Closes it now. Small data are written only then.
    /// @return false when that failed
    [[nodiscard]] bool closed() { return id_ < 0 || close_(std::exchange(id_, -1)) >= 0; }

    [[nodiscard]] hid_t id() const { return id_; }
    [[nodiscard]] bool valid() const { return id_ >= 0; }

private:
    hid_t id_ = -1;
    herr_t (*close_)(hid_t) = nullptr;
};

/// Reads or writes rows of a dataset of numbers some 16 MB at a time, in order, and asks in between.
/// @param first  the first row
/// @param shape  of what is transferred: the number of rows, then the further extents of the dataset
/// @return false as soon as a transfer fails.
/// @throws models::Stopped
template <class Number, class Transfer>
[[nodiscard]] bool transfer_in_blocks(const Hdf5Handle& dataset, hsize_t first, const std::vector<hsize_t>& shape,
                                      Number* numbers, const std::function<bool()>& interrupted,
                                      const Transfer& transfer) {
    constexpr hsize_t block = 1 << 21;
    const hsize_t row = shape.size() > 1 ? shape[1] : 1;
    const hsize_t rows = std::max<hsize_t>(block / std::max<hsize_t>(row, 1), 1);
    const Hdf5Handle file_space(H5Dget_space(dataset.id()), H5Sclose);
    std::vector<hsize_t> start(shape.size(), 0);
    std::vector<hsize_t> count = shape;
    for (hsize_t done = 0; done < shape[0]; done += rows) {
        models::stop_if_asked(interrupted);
        start[0] = first + done;
        count[0] = std::min(rows, shape[0] - done);
        const Hdf5Handle memory_space(H5Screate_simple(static_cast<int>(count.size()), count.data(), nullptr),
                                      H5Sclose);
        if (H5Sselect_hyperslab(file_space.id(), H5S_SELECT_SET, start.data(), nullptr, count.data(), nullptr) < 0 ||
            transfer(dataset.id(), H5T_NATIVE_DOUBLE, memory_space.id(), file_space.id(), H5P_DEFAULT,
                     numbers + done * row) < 0)
            return false;
    }
    return true;
}

/// Keeps HDF5 from printing its error stack while it exists: our exceptions describe the error.
class Hdf5Silence {
public:
    Hdf5Silence() {
        H5Eget_auto2(H5E_DEFAULT, &function_, &data_);
        H5Eset_auto2(H5E_DEFAULT, nullptr, nullptr);
    }
    ~Hdf5Silence() { H5Eset_auto2(H5E_DEFAULT, function_, data_); }
    Hdf5Silence(const Hdf5Silence&) = delete;
    Hdf5Silence& operator=(const Hdf5Silence&) = delete;

private:
    H5E_auto2_t function_ = nullptr;
    void* data_ = nullptr;
};

}  // namespace orbid::orbits
