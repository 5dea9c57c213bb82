#include <unistd.h>
#if defined(__GLIBC__)
#include <malloc.h>
#endif

#include <algorithm>
#include <cstdlib>
#include <exception>
#include <iostream>
#include <new>
#include <string>
#include <string_view>

#include "apps/program/command.hpp"
#include "apps/program/command_line.hpp"

namespace {

/// Where memory ran out and nothing could be unwound: in a thread of a library, or in a function that must not fail.
/// Files are whole all the same, and the next run removes temporaries. Without memory of its own.
[[noreturn]] void end_without_memory() {
    try {
        if (const std::exception_ptr current = std::current_exception()) std::rethrow_exception(current);
    } catch (const std::bad_alloc&) {
        constexpr std::string_view text = "out of memory; what was stored before is whole\n";
        (void)!::write(STDERR_FILENO, text.data(), text.size());
        ::_exit(orbid::apps::out_of_memory);
    } catch (...) {
    }
    std::abort();
}

/// Large arrays are mapped one by one, so that what is freed is free for everything else. glibc raises the size from
/// which it does so to that of the largest array freed, up to 32 MiB: arrays below then stay where they were, with
/// holes between them. Mapping from 1 MiB on saved a series of 20 000 sections a sixth of the memory at no cost, but
/// took 6 % more time for one of 10 000, whose arrays are smaller and used again soon.
void map_large_arrays() {
#if defined(__GLIBC__)
    constexpr int from = 4 << 20;
    (void)::mallopt(M_MMAP_THRESHOLD, from);
#endif
}

}  // namespace

int main(int count, char** arguments) {
    std::set_terminate(end_without_memory);
    map_large_arrays();
    try {
        return orbid::apps::run_command({arguments + 1, arguments + count}, true);
    } catch (const std::bad_alloc&) {
        end_without_memory();
    } catch (const std::exception& error) {
        // Whatever it names, it only shows itself.
        std::string text = error.what();
        std::replace_if(
            text.begin(), text.end(), [](unsigned char c) { return c < ' ' || c >= 0x7F; }, '?');
        std::cerr << "orbid: internal error: " << text << '\n';
        return orbid::apps::not_stored;
    }
}
