#include "apps/stages/workspace.hpp"

#include <string_view>

#include <fmt/format.h>

#include "apps/documents/fingerprint.hpp"

namespace orbid::apps {

namespace {

std::string_view command(Stage stage) {
    switch (stage) {
        case Stage::simulate:
            return "simulate";
        case Stage::orbits:
            return "orbits";
        case Stage::periodic:
            return "periodic";
        case Stage::estimate:
            return "estimate";
        case Stage::all:
            break;
    }
    return "run";
}

}  // namespace

bool reusable(const Workspace& work, Stage stage, const std::filesystem::path& file,
              const std::string& stored_fingerprint, const Fingerprint& wanted) {
    const auto stored = fingerprint_from_text(stored_fingerprint);
    if (stored && !compare(*stored, wanted)) return true;
    const bool later_stage_alone = work.options.stage != Stage::all && work.options.stage != stage;
    if (!later_stage_alone) return false;
    throw StaleFile(
        fmt::format("{}: made by another job ({}); run `orbid {}` or `orbid run` to make it anew", file.string(),
                    stored ? description(*compare(*stored, wanted)) : "it carries no fingerprint", command(stage)));
}

}  // namespace orbid::apps
