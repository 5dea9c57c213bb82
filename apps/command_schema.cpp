#include "apps/command_schema.hpp"

#include <iostream>

#include "apps/description_page.hpp"
#include "apps/description_schema.hpp"
#include "apps/job_description.hpp"

namespace orbid::apps {

std::string job_schema_text() {
    nlohmann::ordered_json document = json_schema(job_description());
    document["title"] = "a job of orbid";
    return document.dump(2) + "\n";
}

std::string job_reference_text() {
    return reference_page(
        job_description(), "All keys of a job",
        "What a job may hold; written by `orbid schema --markdown` from the descriptions that jobs are "
        "read by. How editors are told of them: [jobs.md](jobs.md). A value of a list is shown as `[]`, "
        "of an object whose keys are names as `NAME`.");
}

int show_schema(const CommandCall& call) {
    std::cout << (call.has("markdown") ? job_reference_text() : job_schema_text());
    return 0;
}

}  // namespace orbid::apps
