#include "apps/program/colour.hpp"

#include <unistd.h>

#include <cstdlib>

#include <fmt/format.h>

#include "apps/documents/printable.hpp"
#include "estimator/estimate/estimate.hpp"

namespace orbid::apps {

namespace {

// Codes of ECMA-48 that every terminal with colours knows.
constexpr std::string_view red = "\033[31m";
constexpr std::string_view green = "\033[32m";
constexpr std::string_view reset = "\033[0m";

std::string_view environment(const char* name) {
    const char* value = std::getenv(name);
    return value == nullptr ? std::string_view() : std::string_view(value);
}

}  // namespace

std::vector<std::string> colour_choices() {
    return {"auto", "always", "never"};
}

bool is_coloured(std::string_view choice, std::FILE* stream) {
    if (choice != "auto") return choice == "always";
    return environment("NO_COLOR").empty() && environment("TERM") != "dumb" && stream != nullptr &&
           ::isatty(::fileno(stream)) == 1;
}

std::string error_text(const std::string& raw, bool coloured) {
    const std::string message = printable(raw);
    const auto end = message.find(": ");
    if (!coloured || end == std::string::npos) return message;
    return fmt::format("{}{}{}{}", red, message.substr(0, end + 1), reset, message.substr(end + 1));
}

std::string with_status_colours(const std::string& raw, bool coloured) {
    const std::string summary = printable(raw);
    if (!coloured) return summary;
    using Status = estimator::EstimateStatus;
    std::string text;
    for (std::size_t begin = 0; begin < summary.size();) {
        std::size_t end = summary.find('\n', begin);
        end = end == std::string::npos ? summary.size() : end + 1;
        std::string_view line = std::string_view(summary).substr(begin, end - begin);
        for (const Status status : {Status::converged, Status::no_progress, Status::iteration_limit, Status::singular,
                                    Status::failed, Status::interrupted}) {
            const std::string_view word = estimator::name(status);
            if (!line.starts_with(word) || line.size() <= word.size() || line[word.size()] != ':') continue;
            text += fmt::format("{}{}{}", status == Status::converged ? green : red, word, reset);
            line.remove_prefix(word.size());
            break;
        }
        text += line;
        begin = end;
    }
    return text;
}

}  // namespace orbid::apps
