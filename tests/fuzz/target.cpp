#include "tests/fuzz/target.hpp"

#include <unistd.h>

#include <cstdlib>
#include <fstream>
#include <stdexcept>
#include <string>

#include <fmt/format.h>

namespace orbid::fuzz {

const std::filesystem::path& place() {
    namespace fs = std::filesystem;
    static const fs::path folder = [] {
        const fs::path root = fs::is_directory("/dev/shm") ? fs::path("/dev/shm") : fs::temp_directory_path();
        fs::path made = root / fmt::format("orbid-fuzz-{}", ::getpid());
        fs::create_directories(made);
        return made;
    }();
    // Registered after the path, so that it is removed before.
    static const int registered = std::atexit([] { fs::remove_all(place()); });
    (void)registered;
    return folder;
}

std::filesystem::path written(const std::string& name, std::string_view bytes) {
    std::filesystem::path file = place() / name;
    std::ofstream(file, std::ios::binary | std::ios::trunc) << bytes;
    return file;
}

std::vector<Target> all_targets() {
    std::vector<Target> all = record_targets();
    for (const Target& target : document_targets())
        all.push_back(target);
    return all;
}

Target target_named(std::string_view name) {
    std::string names;
    for (const Target& target : all_targets()) {
        if (target.name == name) return target;
        names += " " + std::string(target.name);
    }
    throw std::invalid_argument("there is no target \"" + std::string(name) + "\"; there are:" + names);
}

}  // namespace orbid::fuzz
