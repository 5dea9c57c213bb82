#include "apps/program/command_model.hpp"

#include <algorithm>
#include <ostream>

#include <fmt/format.h>

#include "apps/documents/json_reader.hpp"
#include "apps/program/starting/model_listing.hpp"
#include "apps/program/starting/starting_campaign.hpp"
#include "apps/program/starting/starting_job.hpp"

namespace orbid::apps {

int show_models(const CommandCall& call) {
    if (call.words.empty()) {
        call.console.out << model_list();
        return 0;
    }
    const std::string& name = call.words[0];
    const auto names = model_names();
    if (std::find(names.begin(), names.end(), name) == names.end())
        throw CommandLineError(fmt::format("there is no model \"{}\"{}", name, suggestion(name, names)));
    call.console.out << model_page(name);
    return 0;
}

namespace {

constexpr std::string_view campaign_word = "campaign";

}  // namespace

std::vector<std::string> starting_subjects() {
    std::vector<std::string> names = starting_models();
    names.emplace(names.begin(), campaign_word);
    return names;
}

std::vector<std::string> starting_purposes() {
    std::vector<std::string> names = starting_tasks();
    const std::vector<std::string> kinds = starting_campaign_kinds();
    names.insert(names.end(), kinds.begin(), kinds.end());
    return names;
}

int show_starting_job(const CommandCall& call) {
    const auto purpose = [&](const char* without) { return call.words.size() > 1 ? call.words[1] : without; };
    try {
        call.console.out << (call.words[0] == campaign_word ? starting_campaign(purpose("sweep"))
                                                            : starting_job(call.words[0], purpose("simulate")));
    } catch (const std::invalid_argument& error) {
        throw CommandLineError(error.what());
    }
    return 0;
}

}  // namespace orbid::apps
