#include "orbits/records/hdf5_library.hpp"

#include <dlfcn.h>

#include "orbits/records/library_function.hpp"

namespace orbid::orbits {
namespace {

/// The library for us alone. It does not clean up when the process ends: all files are closed by then, and after a
/// close that failed, on a full disk, it would crash.
void* own_library() {
    void* const handle = ::dlopen(ORBID_HDF5_LIBRARY, RTLD_NOW | RTLD_LOCAL);
    if (handle == nullptr) return nullptr;
    using Call = herr_t (*)();
    if (const auto dont_atexit = reinterpret_cast<Call>(::dlsym(handle, "H5dont_atexit"))) (void)dont_atexit();
    return handle;
}

/// @return what dlopen gave; null with the reason in dlerror().
void* library() {
    // Loaded once, never unloaded: identifiers that are open may outlive any object of ours. A program that is linked
    // with the library holds its variables itself, by copy relocations: then those count, and not the library's own.
    const bool linked = ::dlsym(RTLD_DEFAULT, "H5open") != nullptr;
    static void* const handle = linked ? ::dlopen(nullptr, RTLD_NOW) : own_library();
    return handle;
}

}  // namespace

void* hdf5_symbol(const char* name) {
    return library_symbol(library(), ORBID_HDF5_LIBRARY, name, "HDF5");
}

}  // namespace orbid::orbits
