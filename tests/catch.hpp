// A guard rather than #pragma once: a precompiled header made in one clone serves others, where this file has another
// path.
#ifndef ORBID_TESTS_CATCH_HPP
#define ORBID_TESTS_CATCH_HPP

// Catch2 is version 2 in Debian 12 and version 3 elsewhere; every test includes this header instead.
#if __has_include(<catch2/catch_all.hpp>)
#include <catch2/catch_all.hpp>
#else
#include <catch2/catch.hpp>
#endif

namespace orbid::tests {
#if __has_include(<catch2/catch_all.hpp>)
using Catch::Matchers::ContainsSubstring;
using Catch::Matchers::WithinAbs;
using Catch::Matchers::WithinRel;
#else
using Catch::Matchers::Contains;
using Catch::Matchers::WithinAbs;
using Catch::Matchers::WithinRel;
inline auto ContainsSubstring(const std::string& text) {
    return Contains(text);
}
#endif
}  // namespace orbid::tests

#endif  // ORBID_TESTS_CATCH_HPP
