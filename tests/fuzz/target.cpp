#include "tests/fuzz/target.hpp"

#include <stdexcept>
#include <string>

namespace orbid::fuzz {

std::vector<Target> all_targets() {
    std::vector<Target> all = text_targets();
    for (const Target& target : file_targets())
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
