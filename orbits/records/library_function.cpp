#include "orbits/records/library_function.hpp"

#include <dlfcn.h>

#include <fmt/format.h>

#include "orbits/records/data_error.hpp"

namespace orbid::orbits {

void* library_symbol(void* handle, const char* library, const char* name, const char* files) {
    void* const symbol = handle == nullptr ? nullptr : ::dlsym(handle, name);
    if (symbol != nullptr) return symbol;
    const char* reason = ::dlerror();
    throw DataError(fmt::format("{} files cannot be used here: {} of {} cannot be loaded{}{}", files, name, library,
                                reason == nullptr ? "" : ": ", reason == nullptr ? "" : reason));
}

}  // namespace orbid::orbits
