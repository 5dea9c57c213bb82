#include "apps/program/command_model.hpp"

#include <algorithm>
#include <ostream>

#include <fmt/format.h>

#include "apps/documents/json_reader.hpp"
#include "apps/program/starting/model_listing.hpp"
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

int show_starting_job(const CommandCall& call) {
    try {
        call.console.out << starting_job(call.words[0], call.words.size() > 1 ? call.words[1] : "simulate");
    } catch (const std::invalid_argument& error) {
        throw CommandLineError(error.what());
    }
    return 0;
}

}  // namespace orbid::apps
