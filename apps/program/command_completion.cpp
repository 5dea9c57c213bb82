#include "apps/program/command_completion.hpp"

#include <ostream>
#include <stdexcept>

#include <fmt/format.h>

#include "apps/program/command_table.hpp"

namespace orbid::apps {

namespace {

/// What bash offers for a word; empty: nothing is known of it.
std::string bash_offer(WordKind kind, std::vector<std::string> (*choices)()) {
    const std::string words = choices != nullptr ? fmt::format("{}", fmt::join(choices(), " ")) : "";
    switch (kind) {
        case WordKind::choice:
            return fmt::format("_orbid_words '{}'", words);
        case WordKind::job_file:
            return words.empty() ? "_orbid_files json" : fmt::format("_orbid_files json '{}'", words);
        case WordKind::file:
            return "_orbid_files";
        case WordKind::folder:
            return "_orbid_folders";
        default:
            return ":";
    }
}

// What is completed is the last word; `place` counts the words that are no options and no values of theirs. bash takes
// "=" for a word of its own.
constexpr std::string_view bash_begin = R"(# Completion of orbid for bash, written by `orbid completion bash`.
_orbid_words() { mapfile -t COMPREPLY < <(compgen -W "$1" -- "$current"); }
_orbid_folders() {
    compopt -o filenames 2>/dev/null
    mapfile -t COMPREPLY < <(compgen -d -- "$current")
}
_orbid_files() {
    compopt -o filenames 2>/dev/null
    mapfile -t COMPREPLY < <(compgen -f ${1:+-X "!*.$1"} -- "$current"; compgen -d -- "$current"
        compgen -W "${2-}" -- "$current")
    ((${#COMPREPLY[@]} < 2)) || mapfile -t COMPREPLY < <(printf '%s\n' "${COMPREPLY[@]}" | sort -u)
}
_orbid() {
    local current=${COMP_WORDS[COMP_CWORD]} previous=${COMP_WORDS[COMP_CWORD - 1]} command=${COMP_WORDS[1]}
    local place=0 value= i
    COMPREPLY=()
    if [[ $current == '=' ]]; then
        current=
    elif [[ $previous == '=' ]]; then
        previous=${COMP_WORDS[COMP_CWORD - 2]}
    fi
    if ((COMP_CWORD == 1)); then
        _orbid_words ')";

constexpr std::string_view bash_places = R"(    esac
    for ((i = 2; i < COMP_CWORD; ++i)); do
        if [[ ${COMP_WORDS[i]} == '=' ]]; then
            value=1
        elif [[ $value ]]; then
            value=
        else
            case "$command ${COMP_WORDS[i]}" in
)";

std::string bash_script() {
    std::string names = "--help --version";
    std::string values;
    std::string switches;
    std::string with_values;
    std::string places;
    for (const Command& command : command_table()) {
        names += " " + command.name;
        std::string list;
        for (const CommandOption& option : all_options(command)) {
            list += (list.empty() ? "--" : " --") + option.name;
            if (option.value.empty()) continue;
            values += fmt::format("        '{} --{}') {}; return ;;\n", command.name, option.name,
                                  bash_offer(option.kind, option.choices));
            with_values += fmt::format("{}'{} --{}'", with_values.empty() ? "" : " | ", command.name, option.name);
        }
        switches += fmt::format("            {}) _orbid_words '{}' ;;\n", command.name, list);
        for (std::size_t i = 0; i < command.words.size(); ++i)
            places += fmt::format("        '{} {}') {} ;;\n", command.name, i,
                                  bash_offer(command.words[i].kind, command.words[i].choices));
    }
    std::string script(bash_begin);
    script += names + "'\n        return\n    fi\n    case \"$command $previous\" in\n" + values;
    script += bash_places;
    script += fmt::format("                {}) value=1 ;;\n", with_values);
    script += "                *' -'*) ;;\n                *) ((++place)) ;;\n            esac\n        fi\n    done\n";
    script += "    if [[ $current == -* ]]; then\n        case $command in\n" + switches;
    script += "        esac\n        return\n    fi\n    case \"$command $place\" in\n" + places;
    return script + "    esac\n}\ncomplete -F _orbid orbid\n";
}

/// Text within single quotes and within the brackets or after the colons of a zsh specification.
std::string zsh_text(const std::string& text) {
    std::string quoted;
    for (const char letter : text) {
        if (letter == '\'') {
            quoted += "'\\''";
        } else {
            if (letter == '[' || letter == ']' || letter == ':' || letter == '\\') quoted += '\\';
            quoted += letter;
        }
    }
    return quoted;
}

std::string zsh_offer(WordKind kind, std::vector<std::string> (*choices)()) {
    const std::string words = choices != nullptr ? fmt::format("({})", fmt::join(choices(), " ")) : "";
    switch (kind) {
        case WordKind::choice:
            return words;
        case WordKind::job_file:
            // A colon within an action is written with a backslash.
            return words.empty() ? "_files -g \"*.json\""
                                 : fmt::format(
                                       "_alternative \"words\\:word\\:{}\" "
                                       "\"files\\:file\\:_files -g \\\"*.json\\\"\"",
                                       words);
        case WordKind::file:
            return "_files";
        case WordKind::folder:
            return "_files -/";
        default:
            return "";
    }
}

std::string zsh_script() {
    std::string names;
    std::string cases;
    for (const Command& command : command_table()) {
        names += fmt::format("        '{}:{}'\n", command.name, zsh_text(command.summary));
        cases += fmt::format("        {})\n            _arguments", command.name);
        for (const CommandOption& option : all_options(command)) {
            cases += fmt::format(" \\\n                '--{}{}[{}]", option.name, option.value.empty() ? "" : "=",
                                 zsh_text(option.meaning));
            if (!option.value.empty()) cases += ":" + option.value + ":" + zsh_offer(option.kind, option.choices);
            cases += "'";
        }
        for (std::size_t i = 0; i < command.words.size(); ++i) {
            const CommandWord& word = command.words[i];
            cases += fmt::format(" \\\n                '{}{}{}:{}'", i + 1, word.optional ? "::" : ":", word.name,
                                 zsh_offer(word.kind, word.choices));
        }
        cases += "\n            ;;\n";
    }
    return "#compdef orbid\n# Completion of orbid for zsh, written by `orbid completion zsh`.\n"
           "_orbid() {\n    local -a commands\n    commands=(\n" +
           names +
           "    )\n    if ((CURRENT == 2)); then\n        _describe command commands\n        return\n    fi\n"
           "    shift words\n    ((CURRENT--))\n    case $words[1] in\n" +
           cases +
           "    esac\n}\n"
           "if [[ $funcstack[1] == _orbid ]]; then\n    _orbid \"$@\"\nelse\n    compdef _orbid orbid\nfi\n";
}

}  // namespace

std::vector<std::string> completion_shells() {
    return {"bash", "zsh"};
}

std::string completion_script(const std::string& shell) {
    if (shell == "bash") return bash_script();
    if (shell == "zsh") return zsh_script();
    throw std::invalid_argument(fmt::format("completion is written for bash and zsh, not for \"{}\"", shell));
}

int show_completion(const CommandCall& call) {
    try {
        call.console.out << completion_script(call.words[0]);
    } catch (const std::invalid_argument& error) {
        throw CommandLineError(error.what());
    }
    return 0;
}

}  // namespace orbid::apps
