#include "orbits/records/hdf5_library.hpp"

#include <dlfcn.h>

#include "orbits/records/library_function.hpp"

namespace orbid::orbits {
namespace {

/// @return what dlopen gave; null with the reason in dlerror().
void* library() {
    // Loaded once, never unloaded: identifiers that are open may outlive any object of ours. A program that is linked
    // with the library holds its variables itself, by copy relocations: then those count, and not the library's own.
    const bool linked = ::dlsym(RTLD_DEFAULT, "H5open") != nullptr;
    static void* const handle = ::dlopen(linked ? nullptr : ORBID_HDF5_LIBRARY, RTLD_NOW | RTLD_LOCAL);
    return handle;
}

}  // namespace

void* hdf5_symbol(const char* name) {
    return library_symbol(library(), ORBID_HDF5_LIBRARY, name, "HDF5");
}

}  // namespace orbid::orbits
