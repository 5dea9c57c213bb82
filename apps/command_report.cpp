#include "apps/command_report.hpp"

#include <cstdio>

#include <fmt/format.h>

#include "apps/atomic_file.hpp"
#include "apps/report_page.hpp"
#include "orbits/data_error.hpp"

namespace orbid::apps {

int write_report(const CommandCall& call) {
    try {
        const StoredRun run = read_stored_run(call.words.at(0));
        const std::filesystem::path file = run.folder / "report.html";
        write_atomically(file, report_html(run));
        fmt::print("{}\n", file.string());
        return 0;
    } catch (const StoredRunRefused& error) {
        fmt::print(stderr, "{}\n", error.what());
        return 2;
    } catch (const orbits::DataError& error) {
        fmt::print(stderr, "{}\n", error.what());
        return 3;
    }
}

void store_report(OutputFolder& folder) {
    try {
        folder.store("report.html", report_html(read_stored_run(folder.file(""))));
    } catch (const StoredRunRefused& error) {
        fmt::print(stderr, "report.html: {}\n", error.what());
    } catch (const orbits::DataError& error) {
        fmt::print(stderr, "report.html: {}\n", error.what());
    }
}

}  // namespace orbid::apps
