#include "apps/stages/workspace.hpp"

#include <array>
#include <utility>

#include <fmt/format.h>

namespace orbid::apps {

namespace {

/// In the order of Stage.
constexpr std::array<std::string_view, 5> commands{"run", "simulate", "orbits", "periodic", "estimate"};

}  // namespace

bool reusable(const Workspace& work, Stage stage, const std::filesystem::path& file,
              const std::string& stored_fingerprint, const Fingerprint& wanted) {
    const auto stored = fingerprint_from_text(stored_fingerprint);
    if (stored && !compare(*stored, wanted)) return true;
    const bool later_stage_alone = work.options.stage != Stage::all && work.options.stage != stage;
    if (!later_stage_alone) return false;
    throw StaleFile(fmt::format("{}: made by another job ({}); run `orbid {}` or `orbid run` to make it anew",
                                file.string(),
                                stored ? description(*compare(*stored, wanted)) : "it carries no fingerprint",
                                commands[static_cast<std::size_t>(stage)]));
}

Fingerprint stage_fingerprint(const nlohmann::json& job, const std::vector<std::string_view>& places) {
    std::vector<std::pair<std::string, std::string>> keys;
    if (job.contains("versions")) keys.emplace_back("/versions", job["versions"].dump());
    for (const std::string_view place : places) {
        const nlohmann::json::json_pointer pointer{std::string(place)};
        if (!job.contains(pointer)) continue;
        const nlohmann::json& value = job.at(pointer);
        if (!value.is_structured() || value.empty()) {
            keys.emplace_back(std::string(place), value.dump());
            continue;
        }
        // flatten() sorts by pointer, so equal jobs give equal lists.
        const nlohmann::json flat = value.flatten();
        for (const auto& [below, leaf] : flat.items())
            keys.emplace_back(std::string(place) + below, leaf.dump());
    }
    return fingerprint(std::move(keys));
}

}  // namespace orbid::apps
