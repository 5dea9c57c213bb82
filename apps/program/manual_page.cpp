#include "apps/program/manual_page.hpp"

#include <ostream>

#include <fmt/format.h>

#include "apps/job/version.hpp"
#include "apps/program/command_help.hpp"
#include "apps/program/command_table.hpp"

namespace orbid::apps {

namespace {

/// Text as troff prints it literally: no request at the beginning of a line, no hyphen for a minus.
std::string troff_text(const std::string& text) {
    std::string result;
    for (const char letter : text) {
        if ((letter == '.' || letter == '\'') && (result.empty() || result.back() == '\n')) result += "\\&";
        if (letter == '\\') {
            result += "\\e";
        } else if (letter == '-') {
            result += "\\-";
        } else {
            result += letter;
        }
    }
    return result;
}

void add_entry(std::string& page, const std::string& bold, const std::string& italic, const std::string& meaning) {
    page += ".TP\n\\fB" + troff_text(bold) + "\\fR" + (italic.empty() ? "" : " \\fI" + troff_text(italic) + "\\fR") +
            "\n" + troff_text(meaning) + "\n";
}

void add_command(std::string& page, const Command& command) {
    page +=
        ".SS \"orbid " + command.name + (command.words.empty() ? "" : " ") + troff_text(usage_words(command)) + "\"\n";
    page += troff_text(command.summary) + ".\n";
    for (const CommandWord& word : command.words)
        if (word.choices != nullptr)
            add_entry(page, word.name, "",
                      with_choices(word.kind == WordKind::choice ? "One of" : "A file, or one of", word.choices));
    for (const CommandOption& option : command.options)
        add_entry(page, "--" + option.name, option.value, with_choices(option.meaning, option.choices));
    if (!command.details.empty()) page += ".PP\n" + troff_text(command.details) + "\n";
    for (const CommandExample& example : command.examples) {
        page += ".PP\n.nf\n.RS\n" + troff_text(example.line) + "\n.RE\n.fi\n";
        if (!example.meaning.empty()) page += ".RS\n" + troff_text(example.meaning) + "\n.RE\n";
    }
}

}  // namespace

std::string manual_page() {
    std::string page = fmt::format(
        ".TH ORBID 1 \"\" \"orbid {}\" \"User Commands\"\n"
        ".SH NAME\norbid \\- parameters of nonlinear systems from chaotic data\n"
        ".SH SYNOPSIS\n.B orbid\n.I COMMAND\n[options]\n"
        ".SH DESCRIPTION\n"
        "Identifies nonlinear dynamical systems: a job, one JSON file, names a model, the data and what is wanted of\n"
        "them; results go to a folder.\n"
        ".SH COMMANDS\n",
        program_version());
    for (const Command& command : command_table())
        add_command(page, command);
    page += ".SH OPTIONS OF ALL COMMANDS\n";
    for (const CommandOption& option : common_options())
        add_entry(page, "--" + option.name, option.value, with_choices(option.meaning, option.choices));
    page += ".SH EXIT STATUS\n";
    for (const ExitCode& code : exit_codes())
        add_entry(page, std::to_string(code.code), "", code.meaning);
    page += ".SH ENVIRONMENT\n";
    for (const EnvironmentVariable& variable : environment_variables())
        add_entry(page, variable.name, "", variable.meaning);
    page += ".SH SIGNALS\n" + troff_text(signals_text()) + "\n";
    return page;
}

int show_manual_page(const CommandCall& call) {
    call.console.out << manual_page();
    return 0;
}

}  // namespace orbid::apps
