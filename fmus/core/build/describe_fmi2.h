/* describe_fmi2.h - modelDescription.xml of FMI 2.0: every element of every row of the model's
 * table is a variable. */
/* SPDX-License-Identifier: BSD-2-Clause */
#ifndef DESCRIBE_FMI2_H
#define DESCRIBE_FMI2_H

#include "describe_text.h"

static void print_variable(size_t row, size_t element, const void *model)
{
    static const char *const kind[] = {
        "parameter\" initial=\"exact",
        "input",
        "output\" initial=\"calculated",
    };
    char name[NAME_SIZE];
    const Variable *v = &fmu_model.variables[row];
    Scalar s = {v, element};
    const double *values = values_from(model, (Scalar){v, 0});

    printf("    <ScalarVariable name=\"%s\" valueReference=\"%u\" causality=\"%s\" "
           "variability=\"%s\"",
           element_name(name, s), (unsigned)(VR_STRIDE * row + element), kind[v->causality],
           variability(v));
    print_description(v);
    printf(">\n      <Real");
    print_real_attributes(v, values);
    if (v->causality != OUTPUT_ROW) print_attribute("start", value_of(fmu_model.start, s));
    printf("/>\n");
    print_annotations(v, "Tool name", "Tool");
    printf("    </ScalarVariable>\n");
}

static void print_variables(const void *model)
{
    printf("  <ModelVariables>\n");
    for (size_t i = 0; i < fmu_model.variable_count; i++)
        for (size_t k = 0; k < fmu_model.variables[i].size; k++) print_variable(i, k, model);
    printf("  </ModelVariables>\n");
}

static void print_unknowns(const char *section, const char *attributes)
{
    unsigned index = 1;
    printf("    <%s>\n", section);
    for (size_t i = 0; i < fmu_model.variable_count; i++)
        for (size_t k = 0; k < fmu_model.variables[i].size; k++, index++)
            if (fmu_model.variables[i].causality == OUTPUT_ROW)
                printf("      <Unknown index=\"%u\"%s/>\n", index, attributes);
    printf("    </%s>\n", section);
}

static void print_fmi2(const Build *b, const void *model)
{
    char guid[GUID_SIZE];
    printf("<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n<fmiModelDescription fmiVersion=\"2.0\" "
           "modelName=\"%s\" "
           "guid=\"%s\"",
           fmu_model.name, guid_of(&fmu_model, guid));
    print_origin(b);
    printf("  <CoSimulation modelIdentifier=\"%s\" canHandleVariableCommunicationStepSize=\"%s\" "
           "canGetAndSetFMUstate=\"true\" "
           "canSerializeFMUstate=\"true\" providesDirectionalDerivative=\"true\">\n    "
           "<SourceFiles>\n",
           fmu_model.name, fmu_model.macro_step ? "false" : "true");
    for (int i = 0; i < b->sources; i++) printf("      <File name=\"%s\"/>\n", b->source[i]);
    printf("    </SourceFiles>\n  </CoSimulation>\n");
    print_units(false);
    print_log_categories();
    print_variables(model);
    printf("  <ModelStructure>\n");
    print_unknowns("Outputs", " dependencies=\"\"");
    print_unknowns("InitialUnknowns", "");
    printf("  </ModelStructure>\n</fmiModelDescription>\n");
}

#endif
