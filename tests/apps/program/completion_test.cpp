// Completion is tried by the shell itself, the manual page by the typesetter.

#include <cstdio>
#include <memory>
#include <set>
#include <sstream>
#include <string>
#include <vector>

#include "apps/program/command_campaign.hpp"
#include "apps/program/command_completion.hpp"
#include "apps/program/command_table.hpp"
#include "apps/program/manual_page.hpp"
#include "apps/program/starting/model_listing.hpp"
#include "tests/apps/program/program.hpp"
#include "tests/catch.hpp"

namespace completion_test {

using namespace orbid;
using namespace orbid::tests;

namespace {

/// Standard output and error of a shell command.
std::string output(const std::string& command) {
    const std::unique_ptr<std::FILE, int (*)(std::FILE*)> pipe(::popen((command + " 2>&1").c_str(), "r"), &::pclose);
    std::string text;
    char buffer[4096];
    for (std::size_t count = 0; (count = std::fread(buffer, 1, sizeof(buffer), pipe.get())) > 0;)
        text.append(buffer, count);
    return text;
}

bool has_program(const std::string& name) {
    return !output("command -v " + name).empty();
}

/// What bash offers for the last of these words, in a folder with two jobs and another folder.
class Shell {
public:
    Shell() {
        write_text(folder_.path() / "completion.bash", apps::completion_script("bash"));
        write_text(folder_.path() / "my job.json", "{}");
        write_text(folder_.path() / "other.json", "{}");
        write_text(folder_.path() / "data.csv", "");
        std::filesystem::create_directory(folder_.path() / "results");
    }
    std::set<std::string> offers(const std::string& words) const {
        std::istringstream stream(
            output("cd '" + folder_.path().string() + "' && bash -u -c 'source completion.bash; COMP_WORDS=(orbid " +
                   words + "); COMP_CWORD=$((${#COMP_WORDS[@]} - 1)); _orbid; printf \"%s\\n\" \"${COMPREPLY[@]}\"'"));
        std::set<std::string> list;
        for (std::string line; std::getline(stream, line);)
            if (!line.empty()) list.insert(line);
        return list;
    }

private:
    TemporaryFolder folder_;
};

}  // namespace

TEST_CASE("bash completes commands, options, models, jobs and folders", "[apps][command]") {
    const Shell shell;
    using List = std::set<std::string>;
    CHECK(shell.offers("si") == List{"simulate"});
    const List commands = shell.offers("\"\"");
    std::size_t callable = 0;
    for (const apps::Command& command : apps::command_table()) {
        CAPTURE(command.name);
        CHECK(commands.count(command.name) == 1);
        ++callable;
        // Every option of every command.
        const List options = shell.offers(command.name + " -");
        for (const apps::CommandOption& option : command.options)
            CHECK(options.count("--" + option.name) == 1);
        CHECK(options.count("--help") == 1);
    }
    CHECK(commands.size() == callable + 2);  // --help, --version
    CHECK(shell.offers("run \"\"") == List{"my job.json", "other.json", "results"});
    CHECK(shell.offers("run o") == List{"other.json"});
    CHECK(shell.offers("run --out \"\"") == List{"results"});
    CHECK(shell.offers("run --out = \"\"") == List{"results"});
    CHECK(shell.offers("run --out results o") == List{"other.json"});
    CHECK(shell.offers("run --threads \"\"").empty());
    CHECK(shell.offers("run --quiet --th") == List{"--threads"});
    const List models = shell.offers("models \"\"");
    for (const std::string& model : apps::model_names())
        CHECK(models.count(model) == 1);
    CHECK(shell.offers("new landing_gear_damper wave") == List{"waveform"});
    CHECK(shell.offers("run other.json \"\"").empty());
    List first{"my job.json", "other.json", "results"};
    for (const std::string& verb : apps::campaign_verbs())
        first.insert(verb);
    CHECK(shell.offers("campaign \"\"") == first);
    CHECK(shell.offers("campaign ret") == List{"retry"});
    CHECK(shell.offers("campaign o") == List{"other.json"});
    CHECK(shell.offers("campaign status \"\"") == List{"results"});
    CHECK(shell.offers("new campaign boot") == List{"bootstrap"});
    CHECK(shell.offers("nonsense \"\"").empty());
}

TEST_CASE("zsh reads its completion", "[apps][command]") {
    const std::string script = apps::completion_script("zsh");
    for (const apps::Command& command : apps::command_table()) {
        CHECK_THAT(script, ContainsSubstring("        " + command.name + ")\n"));
    }
    CHECK_THAT(script, ContainsSubstring("'--out=[folder of the results (default\\: the job'\\''s path without .json)]"
                                         ":DIR:_files -/'"));
    if (!has_program("zsh")) {
        WARN("zsh is not installed: its completion is not read");
        return;
    }
    const TemporaryFolder folder;
    const Path file = write_text(folder.path() / "_orbid", script);
    CHECK(output("zsh -n '" + file.string() + "'").empty());
}

TEST_CASE("another shell has no completion", "[apps][command]") {
    const Outcome refused = orbid_with({"completion", "fish"});
    CHECK(refused.code == 2);
    CHECK_THAT(refused.error, ContainsSubstring("bash and zsh"));
    CHECK(orbid_with({"completion", "bash"}).out == apps::completion_script("bash"));
}

TEST_CASE("the manual page is set without warnings and names everything", "[apps][command]") {
    const std::string page = orbid_with({"man"}).out;
    CHECK(page == apps::manual_page());
    if (!has_program("groff")) {
        WARN("groff is not installed: the manual page is not set");
        return;
    }
    const TemporaryFolder folder;
    const Path file = write_text(folder.path() / "orbid.1", page);
    CHECK(output("groff -ww -b -man -Tascii -z '" + file.string() + "'").empty());
    // Without overstriking, so that words can be found.
    const std::string text = output("groff -man -Tascii -P-c -P-b -P-u '" + file.string() + "'");
    for (const apps::Command& command : apps::command_table()) {
        CAPTURE(command.name);
        CHECK_THAT(text, ContainsSubstring("orbid " + command.name));
        for (const apps::CommandOption& option : command.options)
            CHECK_THAT(text, ContainsSubstring("--" + option.name));
    }
    CHECK_THAT(text, ContainsSubstring("130") && ContainsSubstring("NO_COLOR"));
}

}  // namespace completion_test
