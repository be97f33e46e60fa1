/* describe_fmi3.h - modelDescription.xml of FMI 3.0: every row of the model's table is a variable,
 * an array if it has several elements. Its value reference is the one that its first element has in
 * FMI 2.0. */
/* SPDX-License-Identifier: BSD-2-Clause */
#ifndef DESCRIBE_FMI3_H
#define DESCRIBE_FMI3_H

#include "describe_text.h"

static unsigned row_reference(size_t row) { return (unsigned)(VR_STRIDE * row); }

/* a flag is a number (0 or 1) as in FMI 2.0, so that an FMU of one version can replace an FMU of
 * the other */
static void print_types(void)
{
    for (size_t i = 0; i < fmu_model.variable_count; i++)
        if (is_flag(fmu_model.variables[i].rule)) {
            printf(
                "  <TypeDefinitions>\n    <Float64Type name=\"Flag\" description=\"1: yes, 0: no\" "
                "unit=\"1\" min=\"0\" max=\"1\"/>\n  </TypeDefinitions>\n");
            return;
        }
}

static void print_row_start(const Variable *v)
{
    char text[32];
    const double *start = values_from(fmu_model.start, (Scalar){v, 0});
    printf(" start=\"");
    for (size_t k = 0; k < v->size; k++) printf("%s%s", k ? " " : "", number(text, start[k]));
    putchar('"');
}

static void print_dimensions(const Variable *v)
{
    if (v->columns > 1)
        printf("      <Dimension start=\"%u\"/>\n", (unsigned)(v->size / v->columns));
    printf("      <Dimension start=\"%u\"/>\n", (unsigned)(v->columns > 1 ? v->columns : v->size));
}

static void print_row(size_t row, const void *model)
{
    static const char *const causality[] = {"parameter", "input", "output"};
    const Variable *v = &fmu_model.variables[row];
    bool plain = v->size == 1 && !is_annotated(v);

    printf("    <Float64 name=\"%s\" valueReference=\"%u\" causality=\"%s\" variability=\"%s\"",
           v->name, row_reference(row), causality[v->causality], variability(v));
    print_description(v);
    if (is_flag(v->rule)) printf(" declaredType=\"Flag\"");
    print_real_attributes(v, values_from(model, (Scalar){v, 0}));
    if (v->causality != OUTPUT_ROW) print_row_start(v);
    printf(plain ? "/>\n" : ">\n");
    print_annotations(v, "Annotation type", "Annotation");
    if (v->size > 1) print_dimensions(v);
    if (!plain) printf("    </Float64>\n");
}

static void print_rows(const void *model)
{
    printf("  <ModelVariables>\n");
    for (size_t i = 0; i < fmu_model.variable_count; i++) print_row(i, model);
    printf("    <Float64 name=\"time\" valueReference=\"%u\" causality=\"independent\" "
           "variability=\"continuous\" description=\"simulation time\" unit=\"s\"/>\n"
           "  </ModelVariables>\n",
           row_reference(fmu_model.variable_count));
}

static void print_row_unknowns(const char *element, const char *attributes)
{
    for (size_t i = 0; i < fmu_model.variable_count; i++)
        if (fmu_model.variables[i].causality == OUTPUT_ROW)
            printf("    <%s valueReference=\"%u\"%s/>\n", element, row_reference(i), attributes);
}

static void print_fmi3(const Build *b, const void *model)
{
    char guid[GUID_SIZE];
    printf("<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n<fmiModelDescription fmiVersion=\"3.0\" "
           "modelName=\"%s\" "
           "instantiationToken=\"%s\"",
           fmu_model.name, guid_of(&fmu_model, guid));
    print_origin(b);
    printf("  <CoSimulation modelIdentifier=\"%s\" canHandleVariableCommunicationStepSize=\"%s\" "
           "canGetAndSetFMUState=\"true\" canSerializeFMUState=\"true\" "
           "providesDirectionalDerivatives=\"true\"/>\n",
           fmu_model.name, fmu_model.macro_step ? "false" : "true");
    print_units(true);
    print_types();
    print_log_categories();
    print_rows(model);
    printf("  <ModelStructure>\n");
    print_row_unknowns("Output", " dependencies=\"\"");
    print_row_unknowns("InitialUnknown", "");
    printf("  </ModelStructure>\n</fmiModelDescription>\n");
}

#endif
