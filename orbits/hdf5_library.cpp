#include "orbits/hdf5_library.hpp"

#include <dlfcn.h>

#include <fmt/format.h>

#include "orbits/data_error.hpp"

namespace orbid::orbits {

namespace {

/// @return what dlopen gave; null with the reason in dlerror().
void* library() {
    // Loaded once, never unloaded: identifiers that are open may outlive any object of ours.
    static void* const handle = ::dlopen(ORBID_HDF5_LIBRARY, RTLD_NOW | RTLD_LOCAL);
    return handle;
}

}  // namespace

void* hdf5_symbol(const char* name) {
    void* const handle = library();
    void* const symbol = handle == nullptr ? nullptr : ::dlsym(handle, name);
    if (symbol == nullptr) {
        const char* reason = ::dlerror();
        throw DataError(fmt::format("HDF5 files cannot be used here: {} of {} cannot be loaded{}{}", name,
                                    ORBID_HDF5_LIBRARY, reason == nullptr ? "" : ": ",
                                    reason == nullptr ? "" : reason));
    }
    return symbol;
}

}  // namespace orbid::orbits
