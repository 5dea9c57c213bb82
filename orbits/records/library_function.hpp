#pragma once

namespace orbid::orbits {

/// A function of a shared library under its own name: hides that of the header, which the program does not link.
/// @tparam symbol  gives its address; loads the library on first use.
template <class Function, void* (*symbol)(const char* name)>
class LibraryFunction {
public:
    explicit constexpr LibraryFunction(const char* name) : name_(name) {}
    operator Function*() const { return reinterpret_cast<Function*>(symbol(name_)); }

private:
    const char* name_;
};

/// The address of a name in a library that dlopen has given; with nullptr dlerror() says why there is none.
/// @param files  what cannot be read without it. @throws DataError naming library and reason
[[nodiscard]] void* library_symbol(void* handle, const char* library, const char* name, const char* files);

}  // namespace orbid::orbits
