#include <ostream>

#include "apps/program/command_stored.hpp"
#include "apps/report/run_comparison.hpp"
#include "apps/stored_run/stored_run.hpp"

namespace orbid::apps {

int compare_runs(const CommandCall& call) {
    return with_stored_files(call, [&] {
        const StoredRun first = read_stored_run(call.words[0]);
        const StoredRun second = read_stored_run(call.words[1]);
        call.console.out << comparison_text(first, second);
        return 0;
    });
}

}  // namespace orbid::apps
