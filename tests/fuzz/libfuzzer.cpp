// The targets under libFuzzer, which brings main() along; ORBID_FUZZ_TARGET names the one that is tried.
#include <cstddef>
#include <cstdint>
#include <cstdlib>

#include "tests/fuzz/target.hpp"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
    static const orbid::fuzz::Target target = [] {
        const char* name = std::getenv("ORBID_FUZZ_TARGET");
        return orbid::fuzz::target_named(name == nullptr ? "" : name);
    }();
    target.take({reinterpret_cast<const char*>(data), size});
    return 0;
}
