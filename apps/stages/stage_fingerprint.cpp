#include "apps/stages/stage_fingerprint.hpp"

namespace orbid::apps {

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
