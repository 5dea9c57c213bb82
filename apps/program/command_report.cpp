#include "apps/program/command_report.hpp"

#include <ostream>

#include "apps/documents/atomic_file.hpp"
#include "apps/report/report_page.hpp"
#include "orbits/records/data_error.hpp"

namespace orbid::apps {

int write_report(const CommandCall& call) {
    try {
        const StoredRun run = read_stored_run(call.words.at(0));
        const std::filesystem::path file = run.folder / "report.html";
        write_atomically(file, report_html(run));
        call.console.out << file.string() << '\n';
        return 0;
    } catch (const StoredRunRefused& error) {
        call.console.error << error.what() << '\n';
        return 2;
    } catch (const orbits::DataError& error) {
        call.console.error << error.what() << '\n';
        return 3;
    }
}

void store_report(OutputFolder& folder, std::ostream& complaints) {
    try {
        folder.store("report.html", report_html(read_stored_run(folder.file(""))));
    } catch (const StoredRunRefused& error) {
        complaints << "report.html: " << error.what() << '\n';
    } catch (const orbits::DataError& error) {
        complaints << "report.html: " << error.what() << '\n';
    }
}

}  // namespace orbid::apps
