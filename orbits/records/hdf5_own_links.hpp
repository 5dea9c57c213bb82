#pragma once

#include <array>
#include <cstdio>
#include <memory>
#include <string>

#include "orbits/records/hdf5_library.hpp"

namespace orbid::orbits {

/// Access to the objects of a file that refuses links to other files: one from a stranger must not read ours.
class Hdf5OwnLinks {
public:
    Hdf5OwnLinks()
        : links_(list(H5P_LINK_ACCESS)), groups_(list(H5P_GROUP_ACCESS)), datasets_(list(H5P_DATASET_ACCESS)) {}

    [[nodiscard]] hid_t links() const { return links_.id(); }
    [[nodiscard]] hid_t groups() const { return groups_.id(); }
    [[nodiscard]] hid_t datasets() const { return datasets_.id(); }
    /// The file that a refused link led to; empty: none was refused.
    [[nodiscard]] std::string refused() const { return refused_->data(); }

private:
    using Name = std::array<char, 256>;

    static herr_t refuse(const char*, const char*, const char* file, const char*, unsigned*, hid_t, void* name) {
        auto& text = *static_cast<Name*>(name);
        (void)std::snprintf(text.data(), text.size(), "%s", file == nullptr ? "?" : file);
        return -1;
    }

    [[nodiscard]] Hdf5Handle list(hid_t kind) const {
        Hdf5Handle made(H5Pcreate(kind), H5Pclose);
        H5Pset_elink_cb(made.id(), refuse, refused_.get());
        return made;
    }

    std::unique_ptr<Name> refused_ = std::make_unique<Name>();  ///< stays where it is: the library has its address
    Hdf5Handle links_, groups_, datasets_;
};

/// Whether the numbers of a dataset are in the file that holds it: not in raw files beside it, nor collected from
/// others.
[[nodiscard]] inline bool is_stored_inside(const Hdf5Handle& dataset) {
    const Hdf5Handle properties(H5Dget_create_plist(dataset.id()), H5Pclose);
    return properties.valid() && H5Pget_layout(properties.id()) != H5D_VIRTUAL &&
           H5Pget_external_count(properties.id()) == 0;
}

}  // namespace orbid::orbits
