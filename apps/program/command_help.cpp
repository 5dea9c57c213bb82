#include "apps/program/command_help.hpp"

#include <array>
#include <ostream>

#include <fmt/format.h>

#include "apps/documents/json_reader.hpp"
#include "apps/program/command_table.hpp"

namespace orbid::apps {

namespace {

/// Text broken at blanks so that lines, indented by `indent`, keep within 80 columns. The first is not indented.
std::string wrapped(const std::string& text, std::size_t indent) {
    constexpr std::size_t columns = 80;
    std::string result;
    std::size_t column = indent;
    for (std::size_t begin = 0; begin < text.size();) {
        std::size_t end = text.find(' ', begin);
        if (end == std::string::npos) end = text.size();
        const std::size_t width = end - begin;
        if (column > indent && column + 1 + width > columns) {
            result += "\n" + std::string(indent, ' ');
            column = indent;
        } else if (column > indent) {
            result += ' ';
            ++column;
        }
        result.append(text, begin, width);
        column += width;
        begin = end + 1;
    }
    return result;
}

// What a new user does first.
const std::array<CommandExample, 4> first_steps{{{"orbid models", "what can be identified"},
                                                 {"orbid new free_pendulum series > swing.json", "a commented job"},
                                                 {"orbid check swing.json", "what is wrong with it"},
                                                 {"orbid run swing.json", "results in swing/"}}};
constexpr std::size_t step_width = 44;

std::string option_text(const CommandOption& option) {
    const std::string left = "--" + option.name + (option.value.empty() ? "" : " " + option.value);
    constexpr std::size_t indent = 19;
    return fmt::format("  {:<16} {}\n", left, wrapped(with_choices(option.meaning, option.choices), indent));
}

}  // namespace

std::string usage_words(const Command& command) {
    std::string text;
    for (const CommandWord& word : command.words) {
        if (!text.empty()) text += ' ';
        text += word.optional ? "[" + word.name + "]" : word.name;
    }
    return text;
}

std::string with_choices(const std::string& meaning, std::vector<std::string> (*choices)()) {
    return choices == nullptr ? meaning : fmt::format("{}: {}", meaning, fmt::join(choices(), ", "));
}

std::string program_help() {
    std::string text = "orbid: parameters of nonlinear systems from chaotic data\n\nusage: orbid COMMAND [options]\n\n";
    for (const Command& command : command_table()) {
        constexpr std::size_t indent = 27;
        text +=
            fmt::format("  {:<10} {:<13} {}\n", command.name, usage_words(command), wrapped(command.summary, indent));
    }
    text += "\n  --version, --help, COMMAND --help\n\nfirst steps:\n";
    for (const CommandExample& step : first_steps)
        text += fmt::format("  {:<{}} {}\n", step.line, step_width, step.meaning);
    text += "\nexit codes:\n";
    for (const ExitCode& code : exit_codes())
        text += fmt::format("  {:>3}  {}\n", code.code, wrapped(code.meaning, 7));
    text += "\nenvironment:\n";
    for (const EnvironmentVariable& variable : environment_variables())
        text += fmt::format("  {:<9} {}\n", variable.name, wrapped(variable.meaning, 12));
    return text + "\n" + wrapped(signals_text(), 0) + "\n";
}

const std::vector<ExitCode>& exit_codes() {
    static const std::vector<ExitCode> all{
        {0, "done"},
        {1,
         "done and stored, but no valid answer: not converged, singular, nothing found, or "
         "less than three quarters of the records used"},
        {2, "wrong command line or job"},
        {3, "data cannot be read or used"},
        {4, "results cannot be stored, or an internal error"},
        {5, "out of memory"},
        {130, "interrupted; what there was by then is stored"}};
    return all;
}

const std::vector<EnvironmentVariable>& environment_variables() {
    static const std::vector<EnvironmentVariable> all{
        {"NO_COLOR", "set and not empty: no colours, unless --color always asks for them"}};
    return all;
}

std::string signals_text() {
    return "Ctrl-C (SIGINT), SIGTERM or SIGHUP stops a run and stores what there is by then; a second one ends it at "
           "once. "
           "The same command goes on from the last finished stage, also after a kill.";
}

std::vector<std::string> command_names() {
    std::vector<std::string> names;
    for (const Command& command : command_table())
        names.push_back(command.name);
    return names;
}

int show_help(const CommandCall& call) {
    if (call.words.empty()) {
        call.console.out << program_help();
        return 0;
    }
    for (const Command& command : command_table()) {
        if (command.name != call.words[0]) continue;
        call.console.out << command_help(command);
        return 0;
    }
    throw CommandLineError(
        fmt::format("there is no command \"{}\"{}", call.words[0], suggestion(call.words[0], command_names())));
}

std::string command_help(const Command& command) {
    std::string text = fmt::format("orbid {}: {}\n\nusage: orbid {}{}{} [options]\n\n", command.name, command.summary,
                                   command.name, command.words.empty() ? "" : " ", usage_words(command));
    for (const CommandWord& word : command.words) {
        if (word.choices == nullptr) continue;
        constexpr std::size_t indent = 19;
        const char* kind = word.kind == WordKind::choice ? "" : "a file, or ";
        text += fmt::format("  {:<16} {}\n", word.name,
                            wrapped(fmt::format("{}{}", kind, fmt::join(word.choices(), ", ")), indent));
    }
    text += "options:\n";
    for (const CommandOption& option : all_options(command))
        text += option_text(option);
    if (!command.details.empty()) text += "\n" + command.details + "\n";
    text += command.examples.size() > 1 ? "\nexamples:\n" : "\nexample:\n";
    for (const CommandExample& example : command.examples) {
        text += "  " + example.line + "\n";
        if (!example.meaning.empty()) text += "      " + wrapped(example.meaning, 6) + "\n";
    }
    return text;
}

}  // namespace orbid::apps
